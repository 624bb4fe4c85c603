"""The lines behind the tables of a full run in one compressed file: who has no twelve hours of processor makes the tables
anew from it, and another machine takes the run up where it was left."""
import dataclasses
import json
import lzma


@dataclasses.dataclass
class Programs:
    """What the keys of lines hang on."""
    engine: str      # what it calls itself
    engine_sha: str
    stand_sha: str
    distances_sha: str


def write(path, programs, tables):
    """`tables`: {name: lines}."""
    with lzma.open(path, "wt", preset=9 | lzma.PRESET_EXTREME) as file:
        texts = [json.dumps(dataclasses.asdict(programs))]
        texts += [json.dumps({"table": name, **line}) for name, lines in tables.items() for line in lines]
        file.write("\n".join(texts) + "\n")


def read(path):
    """(programs, {name: lines})"""
    with lzma.open(path, "rt") as file:
        programs = Programs(**json.loads(next(file)))
        tables = {}
        for line in map(json.loads, file):
            tables.setdefault(line.pop("table"), []).append(line)
    return programs, tables
