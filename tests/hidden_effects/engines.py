"""The programs that are asked: the product through its command line, or any other that writes the contract's JSON."""
import dataclasses
import hashlib
import json
import os
import pathlib
import shlex
import shutil
import subprocess

SIDE_CHANNELS = ["--columns", "side=temperature_C,supply_psi"]
NO_REFERENCE = "-"  # what {reference} is for recordings of another machine


class Failed(Exception):
    pass


def run(*command, limit_s=600):
    """(standard output, processor seconds of this and no other child: one case at a time in a process); raises Failed
    with the messages."""
    before = os.times()
    called = " ".join(str(part) for part in [pathlib.Path(command[0]).name, *command[1:2]])
    try:
        done = subprocess.run([str(part) for part in command], capture_output=True, text=True, timeout=limit_s)
    except subprocess.TimeoutExpired:
        raise Failed(f"{called} took more than {limit_s} s") from None
    after = os.times()
    if done.returncode != 0:
        raise Failed(f"{called} ended with {done.returncode}: {done.stderr.strip()[-400:]}")
    return done.stdout, after.children_user + after.children_system - before.children_user - before.children_system


def hash_of(*parts):
    digest = hashlib.sha256()
    for part in parts:
        digest.update(part if isinstance(part, bytes) else str(part).encode())
        digest.update(b"\0")
    return digest.hexdigest()


def answer_of(text):
    try:
        return json.loads(text)
    except ValueError as error:
        raise Failed(f"the answer is not JSON: {error}") from None


@dataclasses.dataclass
class Product:
    valvetriage: pathlib.Path

    def __post_init__(self):
        self.sha = hash_of(self.valvetriage.read_bytes())

    def version(self):
        return run(self.valvetriage, "--version")[0].strip()

    def learn(self, good, reference):
        """Processor seconds that the reference of the folder of good valves has cost."""
        return run(self.valvetriage, "reference", "learn", good, "--valve-type", "type-1", "-o", reference,
                   limit_s=3600)[1]

    def analyse(self, case, folder, reference):
        """(analysis, processor seconds) of the recordings of a folder."""
        options = ["--reference", reference, *SIDE_CHANNELS]
        if case.plant == "motion":
            options = ["--baseline", "self", "--columns", "time=time_s,input=u,output=y"]
        text, seconds = run(self.valvetriage, "analyze", *sorted(folder.glob("*.csv")), *options, "--json")
        return answer_of(text), seconds

    def simulate(self, model, recording, output, initial_samples):
        """The start is found in so many first samples of the recording's own output."""
        run(self.valvetriage, "simulate", "--model", model, "--input", recording, *SIDE_CHANNELS,
            "--initial-samples", initial_samples, "-o", output)


@dataclasses.dataclass
class Command:
    """Another program: `analysis` with {folder} and {reference}; `learning` with {good} and {reference}, without which
    {reference} is the folder of good valves itself."""
    analysis: str
    learning: str = ""

    simulate = None  # its models are its own

    def __post_init__(self):
        self.sha = hash_of(self.analysis, self.learning, *self.files())

    def files(self):
        """The bytes of the programs that are called and of the scripts beside them: what a kept result hangs on."""
        for word in dict.fromkeys(shlex.split(self.analysis) + shlex.split(self.learning)):
            program = pathlib.Path(shutil.which(word) or word)
            if program.is_file():
                for part in (program, *sorted(program.parent.glob("*.py"))):
                    yield part.read_bytes()

    def version(self):
        return self.analysis

    def learn(self, good, reference):
        if self.learning:
            return run(*filled(self.learning, good=good, reference=reference), limit_s=3600)[1]
        shutil.copytree(good, reference)
        return 0.0

    def analyse(self, case, folder, reference):
        given = NO_REFERENCE if case.plant == "motion" else reference
        text, seconds = run(*filled(self.analysis, folder=folder, reference=given))
        return answer_of(text), seconds


@dataclasses.dataclass
class Elsewhere:
    """A program that is not here: what it has answered is."""
    name: str
    sha: str

    simulate = None

    def version(self):
        return self.name


def filled(template, **places):
    """The words of a command with its {places} put in; nothing else is interpreted."""
    words = shlex.split(template)
    for name, value in places.items():
        words = [word.replace("{" + name + "}", str(value)) for word in words]
    return words
