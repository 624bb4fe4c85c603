"""What is hidden in which case: a pure function of a seed. The recordings come from the virtual test stand.

A case's class says what is asked of the analysis (README):
  healthy   nothing is hidden, with or without a decoy
  single    one cause, told from its best rival by d_name >= 8; where a stand knows no d_name, d >= 15
  pair      two causes of different families, each told from its best rival like that
  close     one cause that shows (d >= 6) but has a rival within d_name < 4
  outside   an effect that no cause explains
  step_up   one cause, and one rising step is all there is to see it in
"""
import csv
import dataclasses
import hashlib
import math
import re
import subprocess

CLASSES = ("healthy", "single", "pair", "close", "outside", "step_up")
COLUMNS = ("case", "kind", "plant", "tests", "unit_seed", "noise_seed", "effects", "decoys", "attempt",
           "d", "d_name", "rival", "oracle_set")
DECOY_SPREAD = 2.0  # a decoy's size lies within this factor of its usual one
MOTION_EFFECT = "rectified_sensor"  # the valve's pressure has no sign to lose
# On one rising step these do nothing that a step can show, or need a fall, a second level, a cycle or a second recording.
NOT_ON_STEP_UP = {"asymmetric_response", "intermittent", "side_input", "sensor_drift", "saturation", "backlash"}
NAMED_D = 8.0
CLOSE_D_NAME = 4.0
SHOWS_D = 6.0
PLAIN_D = 15.0  # of each cause, on a stand where d_name is not known
MOST_ATTEMPTS = 40


@dataclasses.dataclass
class Stand:
    """A generator of recordings: its programs in the build folder, the table of its quick suite and that table's mix."""
    program: str
    distances: list
    table: str
    counts: dict
    tells_names: bool  # whether its distances know d_name

    def distances_in(self, build):
        """The command of its program of distances."""
        return [build / self.distances[0], *self.distances[1:]]


STANDS = {
    "first": Stand("valvetriage_stand", ["valvetriage_distances"], "cases.csv",
                   {"healthy": 60, "single": 23, "pair": 9, "close": 8, "outside": 8, "step_up": 12}, True),
    "second": Stand("valvetriage_second_stand", ["valvetriage_second_stand", "distance"], "second_cases.csv",
                    {"healthy": 34, "single": 22, "pair": 6, "outside": 6}, False),
}


class Draws:
    """Numbers that depend on a seed and a name only, equal on every machine."""

    def __init__(self, *key):
        self.key = "/".join(map(str, key))
        self.count = 0

    def uniform(self, low=0.0, high=1.0):
        self.count += 1
        digest = hashlib.sha256(f"{self.key}#{self.count}".encode()).digest()
        return low + (high - low) * int.from_bytes(digest[:6], "big") / 2 ** 48

    def log_uniform(self, low, high):
        return low * math.exp(self.uniform() * math.log(high / low))

    def below(self, n):
        return min(int(self.uniform() * n), n - 1)

    def seed(self):
        return int(self.uniform() * 2 ** 40)


@dataclasses.dataclass
class Case:
    case: str
    kind: str
    plant: str = "valve"
    tests: str = "full"
    unit_seed: int = 1
    noise_seed: int = 1
    effects: list = dataclasses.field(default_factory=list)  # of (name, size)
    decoys: list = dataclasses.field(default_factory=list)   # of (name, size)
    attempt: int = 0
    d: float = math.nan
    d_weaker: float = math.nan  # of a pair: d of the cause that shows less by itself
    d_name: float = math.nan
    rival: str = ""
    oracle_set: float = math.nan

    @property
    def number(self):
        return int(self.case.rsplit("-", 1)[1])

    @property
    def serial(self):
        """The name that the analysis sees; the case's own tells its class."""
        return "V" + hashlib.sha256(f"{self.unit_seed}/{self.noise_seed}".encode()).hexdigest()[:10]

    def stand_arguments(self):
        """What the stand is told: everything but where to write."""
        arguments = ["motion" if self.plant == "motion" else "session", "--serial", self.serial, "--lot", "hidden",
                     "--unit-seed", str(self.unit_seed), "--noise-seed", str(self.noise_seed), "--tests", self.tests]
        for option, hidden in (("--effect", self.effects), ("--decoy", self.decoys)):
            for name, size in hidden:
                arguments += [option, f"{name}={size:.6g}"]
        return arguments


@dataclasses.dataclass
class Effect:
    name: str
    origin: str
    family: str
    smallest: float
    largest: float

    @property
    def outside(self):
        return self.family == "outside"


def repertoire(stand):
    """(effects, decoys): what the stand can hide, by name; decoys with their usual size."""
    effects, decoys, part = {}, {}, None
    for line in subprocess.run([stand, "effects"], check=True, capture_output=True, text=True).stdout.splitlines():
        if not line.startswith(" "):
            part = line.split(":")[0]
        elif part == "effects":
            name, origin, family, smallest, _, largest = line.split()[:6]
            effects[name] = Effect(name, origin, family, float(smallest), float(largest))
        elif part == "decoys":
            name, size = line.split()[:2]
            decoys[name] = float(size)
    return effects, decoys


def counts_for(number, stand):
    """The mix of the stand's quick suite, scaled; at least half are healthy."""
    quick = stand.counts
    whole = sum(quick.values())
    counts = {kind: max(1, n * number // whole) for kind, n in quick.items() if kind != "healthy"}
    return {"healthy": number - sum(counts.values()), **counts}


def name_of(kind, number):
    return f"{kind}-{number:04d}"


def draw(kind, number, seed, attempt, effects, decoys):
    """Case `number` of its class. The valve and its day hang on seed, class and number; what is hidden, on the attempt too:
    a class is filled by trying attempts until one lies in its range of distances."""
    place = Draws(seed, kind, number)
    case = Case(name_of(kind, number), kind, unit_seed=place.seed(), noise_seed=place.seed(), attempt=attempt)
    sizes = Draws(seed, kind, number, "attempt", attempt)
    if kind == "healthy":
        names = list(decoys)
        turn = number % (len(names) + 2)  # two of nine are plain
        if turn < len(names):
            usual = decoys[names[turn]]
            case.decoys = [(names[turn], rounded(sizes.log_uniform(usual / DECOY_SPREAD, usual * DECOY_SPREAD)))]
        return case
    for effect in chosen(kind, number, sizes, effects):
        case.effects.append((effect.name, rounded(sizes.log_uniform(effect.smallest, effect.largest))))
        if effect.name == MOTION_EFFECT:
            case.plant = "motion"  # it plays recordings of its own
    if kind == "step_up":
        case.tests = "step_up"
    return case


def drawn(seed, healthy, faulty, effects, decoys):
    """Cases as they come, whatever their distances: of the faulty a sixth are pairs and a sixth have an effect that no
    cause explains. More of them begin with the same ones, and the classes are mixed, so that a run may end anywhere."""
    counts = {"healthy": healthy, "pair": faulty // 6, "outside": faulty // 6}
    counts["single"] = faulty - counts["pair"] - counts["outside"]
    places = [((number + 0.5) / count, kind, number) for kind, count in counts.items() for number in range(count)]
    return [draw(kind, number, seed, 0, effects, decoys) for _, kind, number in sorted(places)]


def rounded(size):
    """Sizes are told to the stand in this form, so that table and recordings agree."""
    return float(f"{size:.6g}")


def chosen(kind, number, draws, effects):
    """Which effects are hidden. In turn, so that every cause comes as often as any other."""
    causes = [e for e in effects.values() if not e.outside]
    valve_causes = [e for e in causes if e.name != MOTION_EFFECT]
    if kind == "single":
        return [causes[number % len(causes)]]
    if kind == "outside":
        outside = [e for e in effects.values() if e.outside]
        return [outside[number % len(outside)]]
    if kind == "step_up":
        shown = [e for e in valve_causes if e.name not in NOT_ON_STEP_UP]
        return [shown[draws.below(len(shown))]]
    if kind == "close":
        return [valve_causes[draws.below(len(valve_causes))]]
    first = valve_causes[draws.below(len(valve_causes))]
    others = [e for e in valve_causes if e.family != first.family]
    return [first, others[draws.below(len(others))]]


def belongs(case):
    """Whether the distances of a case are those of its class."""
    if case.kind in ("single", "pair"):
        return case.d >= PLAIN_D if math.isnan(case.d_name) else case.d_name >= NAMED_D
    if case.kind == "close":
        return case.d >= SHOWS_D and case.d_name < CLOSE_D_NAME
    if case.kind in ("step_up", "outside"):
        return case.d >= SHOWS_D
    return True


def write_table(path, cases, command):
    with open(path, "w", newline="") as file:
        file.write(f"# {command}\n")
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(COLUMNS)
        for case in cases:
            writer.writerow([cell(getattr(case, column)) for column in COLUMNS])


def cell(value):
    if isinstance(value, list):
        return ";".join(f"{name}={size:.6g}" for name, size in value)
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.4g}"
    return str(value)


def read_table(path):
    with open(path, newline="") as file:
        rows = csv.DictReader(line for line in file if not line.startswith("#"))
        return [case_of(row) for row in rows]


def case_of(row):
    case = Case(row["case"], row["kind"], row["plant"], row["tests"], int(row["unit_seed"]), int(row["noise_seed"]),
                hidden_of(row["effects"]), hidden_of(row["decoys"]), int(row["attempt"]))
    for column in ("d", "d_name", "oracle_set"):
        setattr(case, column, float(row[column]) if row[column] else math.nan)
    case.rival = row["rival"]
    return case


def hidden_of(text):
    return [(name, float(size)) for name, size in re.findall(r"([a-z_]+)=([^;]+)", text)]
