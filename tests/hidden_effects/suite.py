"""The cases of a full run, and the lines that are kept about them."""
import concurrent.futures
import sys

import cases as drawing
import engines
import playing
import results
import studies
from kept import Kept


class Suite:
    """The cases, and the lines there are about them."""

    def __init__(self, options):
        self.options = options
        self.answers = Kept(options.work / "full" / "answers.jsonl")
        self.distances = Kept(options.work / "full" / "distances.jsonl")
        self.loops = Kept(options.work / "full" / "loops.jsonl")
        self.stand = drawing.STANDS[options.stand]
        self.program = tuple(self.stand.distances_in(options.build))
        self.program_sha = engines.hash_of(self.program[0].read_bytes())
        self.effects, decoys = drawing.repertoire(options.build / self.stand.program)
        self.cases = drawing.drawn(options.seed, options.healthy, options.faulty, self.effects, decoys)

    def bench(self, engine=None, **reference):
        return playing.Bench(self.options.build / "valvetriage", self.options.build / self.stand.program,
                             self.options.work, engine=engine, **reference)

    def distance_key(self, case, name_too):
        return studies.distance_key(self.program_sha, case, name_too)

    def known_distances(self, case):
        """The line of a case's distances, with d_name if that has been measured; None where nothing has."""
        keys = [self.distance_key(case, name_too) for name_too in (True, False)]
        return next((self.distances[key] for key in keys if key in self.distances), None)

    def measured(self, case):
        return studies.with_distances(case, self.known_distances(case))

    def outcomes(self, bench, cases):
        """Of the cases that have been answered."""
        answered = [case for case in cases if bench.key(case) in self.answers]
        return [results.outcome_of(self.measured(case), self.answers[bench.key(case)]) for case in answered]

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
            known = self.known_distances(case)
            if case.effects and case.plant == "valve" and (not known or (name_too and "d_name" not in known)):
                key = self.distance_key(case, name_too)
                tasks.append((key, (studies.distances_line, key, self.program, case, name_too)))
        self.fill(pool, self.distances, "distances", tasks)

    def ask(self, pool, bench, cases, what):
        bench.learn_reference()
        self.fill(pool, self.answers, what, [
            (bench.key(case), (studies.answer_line, bench.key(case), bench, self.measured(case))) for case in cases])

    def close_loops(self, pool, bench, cases):
        self.fill(pool, self.loops, "closed loops", [
            (bench.key(case), (studies.loop_line, bench.key(case), bench, case))
            for case in self.ambiguous(bench, cases)])

    def fill(self, pool, kept, what, tasks):
        missing = [call for key, call in tasks if key not in kept]
        try:
            for number, future in enumerate(concurrent.futures.as_completed([pool.submit(*call) for call in missing])):
                kept.add(future.result())
                print(f"\r{what}: {number + 1} of {len(missing)}", end="", file=sys.stderr, flush=True)
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)  # or hundreds of answers are asked for and thrown away
            raise
        if missing:
            print(file=sys.stderr)
