"""The cases of a full run, and the lines that are kept about them."""
import concurrent.futures
import dataclasses
import sys

import cases as drawing
import engines
import playing
import published
import results
import studies
from kept import Kept


class Suite:
    """The cases, and the lines there are about them."""

    def __init__(self, options):
        self.options = options
        self.tables = {name: Kept(options.work / "full" / f"{name}.jsonl")
                       for name in ("answers", "distances", "loops", "held_out")}
        self.answers, self.distances, self.loops, self.held_out = self.tables.values()
        self.stand = drawing.STANDS[options.stand]
        self.program = tuple(self.stand.distances_in(options.build))
        self.distances_sha = engines.hash_of(self.program[0].read_bytes())
        self.stand_sha = ""  # that of the build, unless another's answers are reported
        self.effects, decoys = drawing.repertoire(options.build / self.stand.program)
        self.cases = drawing.drawn(options.seed, options.healthy, options.faulty, self.effects, decoys)
        if options.tests != "full":
            self.cases = [dataclasses.replace(case, tests=options.tests) for case in self.cases if case.plant == "valve"]

    def bench(self, engine=None, **reference):
        return playing.Bench(self.options.build / "valvetriage", self.options.build / self.stand.program,
                             self.options.work, engine=engine, stand_sha=self.stand_sha, **reference)

    def programs(self, bench):
        return published.Programs(bench.engine.version(), bench.engine.sha, bench.stand_sha, self.distances_sha)

    def report_of(self, programs):
        """From now on keys are those of other programs; the engine to ask of is returned, which answers nothing new."""
        self.stand_sha, self.distances_sha = programs.stand_sha, programs.distances_sha
        return engines.Elsewhere(programs.engine, programs.engine_sha)

    def add(self, tables):
        for name, lines in tables.items():
            self.tables[name].lines |= {line["key"]: line for line in lines}

    def lines_of(self, asked):
        """{table: lines} of the cases that each bench is asked of, as `published` takes them."""
        keys = [bench.key(case) for bench, cases in asked for case in cases]
        of_distances = [self.distance_key(case, name_too) for _, cases in asked for case in cases
                        for name_too in (False, True)]
        return {name: [table[key] for key in dict.fromkeys(of_distances if name == "distances" else keys) if key in table]
                for name, table in self.tables.items()}

    def distance_key(self, case, name_too):
        return studies.distance_key(self.distances_sha, case, name_too)

    def known_distances(self, case):
        """What has been measured of a case's distances, by name; empty where nothing has."""
        known = {}
        for name_too in (False, True):
            key = self.distance_key(case, name_too)
            known |= self.distances[key] if key in self.distances else {}
        return known

    def measured(self, case):
        return studies.with_distances(case, self.known_distances(case))

    def outcomes(self, bench, cases):
        """Of the cases that have been answered."""
        keys = [(case, bench.key(case)) for case in cases]
        return [results.outcome_of(self.measured(case), self.answers[key], self.held_out.get(key))
                for case, key in keys if key in self.answers]

    def ambiguous(self, bench, cases):
        """Those whose answer is ambiguous and asks for a test."""
        answers = [(case, self.answers[bench.key(case)]["answer"]) for case in cases
                   if case.plant == "valve" and bench.key(case) in self.answers]
        return [case for case, answer in answers
                if answer and answer["conclusion"] == "ambiguous" and answer["next_test"]]

    def loop_outcomes(self, bench, cases):
        lines = [(case, bench.key(case)) for case in self.ambiguous(bench, cases)]
        return [(self.measured(case), self.answers[key], self.loops[key]) for case, key in lines if key in self.loops]

    def measure(self, pool):
        tasks = []
        for case in self.cases:
            name_too = self.stand.tells_names and case.number < self.options.names
            asked = {"d"} | ({"d_name"} if name_too else set()) | ({"d_weaker"} if len(case.effects) > 1 else set())
            if case.effects and case.plant == "valve" and not asked <= set(self.known_distances(case)):
                key = self.distance_key(case, name_too)
                tasks.append((studies.distances_line, key, self.program, case, name_too))
        self.fill(pool, self.distances, "distances", tasks)

    def ask(self, pool, bench, cases, what):
        bench.learn_reference()
        self.fill(pool, self.answers, what, [
            (studies.answer_line, bench.key(case), bench, self.measured(case))
            for case in cases if bench.key(case) not in self.answers])

    def close_loops(self, pool, bench, cases):
        self.fill(pool, self.loops, "closed loops", [
            (studies.loop_line, bench.key(case), bench, case)
            for case in self.ambiguous(bench, cases) if bench.key(case) not in self.loops])

    def hold_out(self, pool, bench, cases):
        """Of the first --held-out single causes, those that are large enough."""
        first = [self.measured(case) for case in cases if case.number < self.options.held_out]
        self.fill(pool, self.held_out, "held out", [
            (studies.held_out_line, bench.key(case), bench, case) for case in first
            if bench.engine.simulate and playing.has_recording_to_hold_out(case) and bench.key(case) not in self.held_out])

    def fill(self, pool, kept, what, calls):
        try:
            for number, future in enumerate(concurrent.futures.as_completed([pool.submit(*call) for call in calls])):
                kept.add(future.result())
                print(f"\r{what}: {number + 1} of {len(calls)}", end="", file=sys.stderr, flush=True)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)  # or hundreds of answers are asked for and thrown away
            raise
        if calls:
            print(file=sys.stderr)
