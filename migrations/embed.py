#!/usr/bin/env python3
"""Writes migrations/sqlite/NNNN_*.sql into one C++ source: embed.py OUTPUT FILE..."""
import pathlib
import sys

output, files = pathlib.Path(sys.argv[1]), [pathlib.Path(name) for name in sys.argv[2:]]
steps = []
for expected, file in enumerate(sorted(files, key=lambda f: f.name), start=1):
    if int(file.name[:4]) != expected:
        sys.exit(f"{file.name}: expected number {expected:04}: migrations are numbered without a gap")
    steps.append(f'    {{{expected}, "{file.stem}", R"sql({file.read_text()})sql"}},')
output.write_text(
    '#include "server/store/sqlite/migrate.h"\n\nnamespace valvetriage::sqlite {\nnamespace {\n\n'
    "constexpr Migration kMigrations[] = {\n" + "\n".join(steps) + "\n};\n\n}  // namespace\n\n"
    "std::span<const Migration> migrations() { return kMigrations; }\n\n}  // namespace valvetriage::sqlite\n")
