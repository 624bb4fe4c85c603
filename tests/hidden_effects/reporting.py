"""The scorer's text: a line per case, the marks, the confusion and the plane of the two distances."""
import collections

import scoring


def case_line(outcome):
    hidden = "+".join(f"{name}={size:.4g}" for name, size in zip(outcome["hidden"], outcome["sizes"]))
    said = []
    for cause, probability, rivals in outcome["said"]:
        said.append(f"{cause} {probability:.2f}" + (f" or {','.join(rivals)}" if rivals else ""))
    text = f"{outcome['case']:<14} {outcome['outcome']:<11} {hidden or outcome['decoy'] or 'plain':<34}"
    if outcome["d"] is not None:
        text += f" d {outcome['d']:<5.3g}"
    if outcome["d_name"] is not None:
        text += f" d_name {outcome['d_name']:<5.3g} ({outcome['rival']})"
    if outcome["conclusion"]:
        text += f"  -> {outcome['conclusion']}" + (f": {'; '.join(said)}" if said else "")
    if outcome["outcome"] not in ("right", "no_answer", "failed") and outcome["top_candidates"]:
        text += "  [" + ", ".join(f"{cause} {p:.2f}" for cause, p in outcome["top_candidates"]) + "]"
    if outcome["closed_share"] is not None:
        text += f"  closed {outcome['closed_share']:.3f}"
    return text + (f"  {outcome['failure']}" if outcome["failure"] else "")


def report(outcomes, floors=None):
    """The whole table as text."""
    lines = [case_line(outcome) for outcome in outcomes] + [""]
    lines += kinds_table(outcomes) + [""] + marks_table(scoring.figures(outcomes), floors) + [""]
    lines += confusion_table(outcomes) + [""] + plane_table(outcomes) + [""] + parameter_table(outcomes)
    return "\n".join(lines).rstrip() + "\n"


def kinds_table(outcomes):
    counts = collections.defaultdict(collections.Counter)
    for outcome in outcomes:
        counts[outcome["kind"] + (f" {outcome['decoy']}" if outcome["decoy"] else "")][outcome["outcome"]] += 1
    lines = ["class: outcomes"]
    for kind in sorted(counts):
        lines.append(f"  {kind:<26} " + ", ".join(f"{n} {word}" for word, n in counts[kind].most_common()))
    return lines


def marks_table(figures, floors):
    lines = [f"{'figure':<26} {'reached':>9} {'mark':>9} {'floor':>9}"]
    for name, value in figures.items():
        mark, larger = scoring.MARKS.get(name, (None, True))
        met = "" if mark is None or value is None else ("  met" if (value >= mark if larger else value <= mark) else "  missed")
        lines.append(f"{name:<26} {number(value):>9} {number(mark):>9} {number((floors or {}).get(name)):>9}{met}")
    return lines


def number(value):
    return "-" if value is None else f"{value:.4g}"


def confusion_table(outcomes):
    lines = ["hidden: said (~ has rivals)"]
    for hidden, said in sorted(scoring.confusion(outcomes).items()):
        lines.append(f"  {hidden:<42} " + ", ".join(f"{n} {text}" for text, n in said.most_common()))
    return lines


def plane_table(outcomes):
    cells = scoring.plane(outcomes)
    if not cells:
        return ["no distances are known"]
    bins = scoring.D_BINS
    columns = range(len(bins) - 1)
    lines = ["one cause hidden: named right / truth inside / cases, by d (down) and d_name (across), from",
             " " * 8 + "".join(f"{bins[i]:>12g}" for i in columns)]
    for row in columns:
        texts = ["{}/{}/{}".format(*cells[row, i]) if (row, i) in cells else "" for i in columns]
        if any(texts):
            lines.append(f"{bins[row]:>8g}" + "".join(f"{text:>12}" for text in texts))
    return lines


def parameter_table(outcomes):
    rows = collections.defaultdict(list)
    for outcome in outcomes:
        for cause, name, true, estimate, inside in outcome["parameters"]:
            rows[f"{cause} {name}"].append((estimate / true - 1 if true else estimate, inside))
    lines = ["parameter: cases, median relative error, inside the 95 % interval"] if rows else []
    for name in sorted(rows):
        errors = sorted(error for error, _ in rows[name])
        lines.append(f"  {name:<48} {len(errors):>4} {errors[len(errors) // 2]:>+9.3f} "
                     f"{sum(inside for _, inside in rows[name])}/{len(errors)}")
    return lines
