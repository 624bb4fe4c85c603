"""What an answer about a machine is worth."""
from machine import LINEAR, OUTSIDE

OUTCOMES = ("right", "right_set", "unexplained", "missed", "doubted", "open", "wrong_set", "wrong")


def judged(truth, discrepancy):
    """right      what is there is named, or `none` of a linear machine, or `unexplained` where there is no name for it
    right_set     open between causes of which one is right
    unexplained   structure, though there is a name for it
    missed        `none`, though something is wrong
    doubted       a linear machine that is not `none`
    open          causes named as possible where none is right
    wrong_set     the same where another one is
    wrong         a name with confidence that is not the truth"""
    conclusion = discrepancy["conclusion"]
    causes = [cause["cause"] for cause in discrepancy["causes"]]
    offered = set(causes).union(*(cause["alternatives"] for cause in discrepancy["causes"]))
    if truth == LINEAR:
        return {"none": "right", "named": "wrong"}.get(conclusion, "doubted")
    if conclusion == "none":
        return "missed"
    if truth == OUTSIDE:
        return {"unexplained": "right", "named": "wrong"}.get(conclusion, "open")
    if conclusion == "unexplained":
        return "unexplained"
    if conclusion == "named":
        return "right" if set(causes) <= set(truth) else "wrong"
    return "right_set" if offered & set(truth) else "wrong_set"
