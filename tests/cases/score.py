#!/usr/bin/env python3
"""Has the cases of generate.py diagnosed, one at a time, and says how near the answers came. See README.md beside this file.

    score.py CASES RESULTS [--command "rig diagnose {experiment} --out {out}"] [--limit-s S] [--share X] [--family NAME]...
    score.py CASES RESULTS --judge-only

RESULTS/case-NNNN/diagnosis.json is what is read: another program's answers may be put there. Started again it goes on where it
stopped. Needs nothing but Python.
"""

import argparse
import json
import shlex
import statistics
import subprocess
import time
from pathlib import Path

from judge import OUTCOMES, Judge

DEFAULT_COMMAND = "rig diagnose {experiment} --out {out}"
# A program that keeps no time limit is ended after this many times it [s without one]
PATIENCE, PATIENCE_S = 4.0, 600.0
# Multiples of it, without their whole part, fill the range from 0 to 1 evenly however many there are
GOLDEN = 0.6180339887498949


def chosen(cases, families, share):
    """Cases in the order in which they are gone through: of each family a part that is spread over its kinds."""
    list_ = []
    for path in (cases / "hidden").glob("case-*.json"):
        hidden = json.loads(path.read_text())
        place = hidden["case"] * GOLDEN % 1.0
        if place < share and (not families or hidden["family"] in families):
            list_.append((place, path.stem, hidden))
    return [(name, hidden) for _, name, hidden in sorted(list_, key=lambda entry: entry[:2])]


def limited(experiment, limit_s):
    """The experiment with a time limit, a file beside it."""
    if limit_s is None:
        return experiment
    stated = experiment.with_name(f"experiment-{limit_s:g}s.toml")
    stated.write_text(experiment.read_text() + f"\n[diagnose]\nlimit_s = {limit_s:.1f}\n")
    return stated


def run(command, experiment, out, limit_s):
    """Runs the program on a case and notes how it ended."""
    out.mkdir(parents=True, exist_ok=True)
    words = [word.format(experiment=experiment, out=out) for word in shlex.split(command)]
    began = time.monotonic()
    try:
        ended = subprocess.run(words, capture_output=True, text=True, timeout=PATIENCE * limit_s if limit_s else PATIENCE_S)
        code, said = ended.returncode, ended.stderr[-3000:]
    except subprocess.TimeoutExpired:
        code, said = None, "ended from outside: no answer in time"
    note = {"seconds": round(time.monotonic() - began, 2), "code": code, "stderr": said}
    (out / "ended.json").write_text(json.dumps(note, indent=1) + "\n")


def judged(name, hidden, out):
    """What became of a case; `None` where nobody has gone through it."""
    note, answer = out / "ended.json", out / "diagnosis.json"
    note = json.loads(note.read_text()) if note.exists() else {}
    if not note and not answer.exists():
        return None
    diagnosis = json.loads(answer.read_text()) if answer.exists() and note.get("code", 0) is not None else None
    refusal = note.get("stderr", "") if diagnosis is None and note.get("code") in (2, 4) else ""
    judge = Judge(hidden, diagnosis, refusal)
    outcome, false = judge.outcome()
    d = diagnosis or {}
    names = lambda key: [c["name"] + (f"/{c['element']}" if c.get("element") else "") + ("@" if c.get("by_run") else "") for c in d.get(key) or []]
    return {
        "case": name,
        "family": hidden["family"],
        "hidden": ([f["cause"] + (f"/{f['elements'][0]}" if f["elements"][0] else "") + ("@" if f["by_run"] else "") for f in hidden["faults"]]
                   + [hidden[key]["kind"] for key in ("description", "outside", "tracker") if hidden[key]]),
        "outcome": outcome,
        "false": false,
        "verdict": d.get("verdict", (refusal or note.get("stderr", ""))[-160:].strip()),
        "causes": names("causes"),
        "established": names("established"),
        "alternatives": ["+".join(other["names"]) for other in d.get("alternatives") or []],
        "intervals": {key: judge.intervals(key) for key in ("causes", "established")},
        "complete": d.get("complete", True),
        "seconds": note.get("seconds"),
    }


def line(one):
    said = "+".join(one["causes"]) or "+".join(one["established"]) and "established " + "+".join(one["established"])
    others = f" [{'; '.join(one['alternatives'])}]" if one["alternatives"] else ""
    worst = max((d for held in one["intervals"].values() for _, _, d in held), default=None)
    return (f"{one['case']} | {' + '.join(one['hidden']) or 'nothing'} | {one['verdict']} {said}{others} | {one['outcome']}"
            f"{' (' + ', '.join(one['false']) + ')' if one['false'] else ''} | {'' if worst is None else f'{worst:.1f} sd'} | {one['seconds']} s"
            f"{'' if one['complete'] else ', cut'}")


def table(all_):
    """Outcomes by family, as Markdown."""
    head = ["family", "n", *OUTCOMES, "intervals under causes", "under established", "s median", "s worst", "cut"]
    rows = ["| " + " | ".join(head) + " |", "|" + " --- |" * len(head)]
    for family in [*dict.fromkeys(one["family"] for one in all_), None]:
        part = [one for one in all_ if family in (one["family"], None)]
        cells = [family or "all", len(part)]
        cells += [sum(one["outcome"] == outcome for one in part) or "" for outcome in OUTCOMES]
        for key in ("causes", "established"):
            held = [h for one in part for _, h, _ in one["intervals"][key]]
            cells.append(f"{sum(held)} of {len(held)}" if held else "")
        times = [one["seconds"] for one in part if one["seconds"] is not None]
        cells += [f"{statistics.median(times):.1f}", f"{max(times):.1f}"] if times else ["", ""]
        cells.append(sum(not one["complete"] for one in part) or "")
        rows.append("| " + " | ".join(str(cell) for cell in cells) + " |")
    return "\n".join(rows)


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("cases", type=Path)
    parser.add_argument("results", type=Path)
    parser.add_argument("--command", default=DEFAULT_COMMAND)
    parser.add_argument("--limit-s", type=float, help="stated as limit_s under [diagnose]; left out: the program's own")
    parser.add_argument("--share", type=float, default=1.0, help="share of each family")
    parser.add_argument("--family", action="append")
    parser.add_argument("--judge-only", action="store_true", help="run nothing; judge what lies in RESULTS")
    options = parser.parse_args()
    cases, results = options.cases.resolve(), options.results.resolve()
    all_ = []
    for name, hidden in chosen(cases, options.family, options.share):
        out = results / name
        fresh = not options.judge_only and not (out / "ended.json").exists()
        if fresh:
            run(options.command, limited(cases / name / "experiment.toml", options.limit_s), out, options.limit_s)
        one = judged(name, hidden, out)
        if one:
            all_.append(one)
            print(line(one), flush=True)
    results.mkdir(parents=True, exist_ok=True)
    (results / "scores.json").write_text(json.dumps(all_, indent=1) + "\n")
    print("\n" + table(all_))


if __name__ == "__main__":
    main()
