#!/usr/bin/env python3
"""Builds files into the binary: writes a C++ source with every file's bytes; YAML becomes JSON.

Where the page says `<!-- modules -->` stand links that fetch every module at once: else a browser finds them one
import after the other.

usage: embed.py OUT.cpp FILE...
"""
import json
import pathlib
import sys

CONTENT_TYPES = {
    ".css": "text/css; charset=utf-8",
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".json": "application/json",
    ".svg": "image/svg+xml",
}


def content_of(path, modules):
    if path.suffix == ".html":
        links = "\n".join(f'<link rel="modulepreload" href="/web/{name}">' for name in modules)
        return path.name, path.read_bytes().replace(b"<!-- modules -->", links.encode())
    if path.suffix != ".yaml":
        return path.name, path.read_bytes()
    import yaml

    document = yaml.safe_load(path.read_text(encoding="utf-8"))
    return path.stem + ".json", json.dumps(document, separators=(",", ":")).encode()


def array(number, content):
    values = ",".join(str(byte - 256 if byte > 127 else byte) for byte in content)
    return f"constexpr char kFile{number}[] = {{{values}}};\n"


def entry(number, name):
    kind = CONTENT_TYPES[pathlib.Path(name).suffix]
    return f'    {{"{name}", "{kind}", {{kFile{number}, sizeof kFile{number}}}}},\n'


def main():
    out, *files = (pathlib.Path(argument) for argument in sys.argv[1:])
    modules = [path.name for path in files if path.suffix == ".js" and not path.name.endswith(".min.js")]
    contents = [content_of(path, modules) for path in files]
    out.write_text(
        '#include "server/http/assets.h"\n\nnamespace valvetriage::http {\nnamespace {\n\n'
        + "".join(array(i, content) for i, (_, content) in enumerate(contents))
        + "\nconstexpr Asset kAssets[] = {\n"
        + "".join(entry(i, name) for i, (name, _) in enumerate(contents))
        + "};\n\n}  // namespace\n\n"
        "const Asset* find_asset(std::string_view name) {\n"
        "  for (const Asset& asset : kAssets) {\n"
        "    if (asset.name == name) return &asset;\n"
        "  }\n"
        "  return nullptr;\n"
        "}\n\n}  // namespace valvetriage::http\n",
        encoding="utf-8",
    )


main()
