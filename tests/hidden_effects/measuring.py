"""The distances of a case, from a stand's own program of distances."""
import math
import subprocess


class Distances:
    """One running program that answers a line per case."""

    def __init__(self, *command):
        self.process = subprocess.Popen([str(part) for part in command], stdin=subprocess.PIPE, stdout=subprocess.PIPE,
                                        text=True)

    def measure(self, case, wanted):
        """`wanted` is the class that the case is to belong to, `detect` for d alone, or `any`."""
        case.d, case.d_name, case.oracle_set, case.rival = self.ask(case, wanted, case.effects)
        if math.isnan(case.d_name) and wanted == case.kind:  # without it, each of a pair has to be plain by itself
            case.d = self.weaker(case)
        return case

    def weaker(self, case):
        """d of that cause of a pair which shows less by itself."""
        return min(self.ask(case, "detect", [effect])[0] for effect in case.effects)

    def ask(self, case, wanted, effects):
        """(d, d_name, oracle_set, rival)"""
        hidden = ",".join(f"{name}={size:.6g}" for name, size in effects)
        self.process.stdin.write(f"{wanted} {case.tests} {case.unit_seed} {case.noise_seed} {hidden}\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().split()
        if len(answer) != 4:
            raise RuntimeError(f"{case.case}: no distances")
        return *map(float, answer[:3]), answer[3]
