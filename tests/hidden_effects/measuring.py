"""The distances of a case, from valvetriage_distances."""
import subprocess


class Distances:
    """One running program that answers a line per case."""

    def __init__(self, program):
        self.process = subprocess.Popen([str(program)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def measure(self, case, wanted):
        """`wanted` is the class that the case is to belong to, `detect` for d alone, or `any`."""
        effects = ",".join(f"{name}={size:.6g}" for name, size in case.effects)
        self.process.stdin.write(f"{wanted} {case.tests} {case.unit_seed} {case.noise_seed} {effects}\n")
        self.process.stdin.flush()
        answer = self.process.stdout.readline().split()
        if len(answer) != 4:
            raise RuntimeError(f"{case.case}: no distances")
        case.d, case.d_name, case.oracle_set = float(answer[0]), float(answer[1]), float(answer[2])
        case.rival = answer[3]
        return case
