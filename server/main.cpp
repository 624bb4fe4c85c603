#include <cstdio>

int main() {
  std::puts("valvetriage " VALVETRIAGE_VERSION);
  return 0;
}
