#!/usr/bin/env python3
"""Holds the generator against the simulation: the same cause of the same size in both, in millimetres. See README.md beside this file.

    check.py [--rig PATH] [CAUSE]...

Both move each cause's first case of the family `one`, a drop and a driven run. Needs `pip install mujoco numpy` and a built rig.
"""

import argparse
import csv
import subprocess
import tempfile
from pathlib import Path

import numpy as np

from faults import ORDINARY
from generate import Case
from tank import Tank

LASTS_S, EVERY_S, ROW_S, ACCURACY_M = 1.8, 0.01, 0.001, 1e-6
MARGIN_S = 0.1  # at both ends, for what looks at other instants
# What `rig simulate` takes from a model's geometry instead
NOT_IN_SIMULATE = {"link_length", "joint_zero"}


def simulated(rig, case, place, hidden, pose, folder):
    """Times and keypoints by `rig simulate`, shape (rows, links, 2)."""
    mechanism, run = case.mechanism, case.runs[place]
    numbers = dict(hidden)
    if "servo_rate_limit/rate" in numbers:
        numbers["servo_rate_limit/share"] = 1.0
    text = mechanism.mjcf(true=True)
    told = case.strokes[place].command if run.kind == "driven" else np.zeros_like
    if run.kind == "drop" and mechanism.led:
        # the driven hinge is free
        text = text[: text.index("  <actuator>")] + "</mujoco>\n"
        numbers = {name: x for name, x in numbers.items() if not name.startswith(("servo_", "backlash"))}
    lines = "".join(f'<numeric name="{name}" data="{float(x)!r}"/>' for name, x in numbers.items())
    model, servo, out = folder / "model.xml", folder / "servo.csv", folder / "out.csv"
    model.write_text(text.replace("</mujoco>", f"<custom>{lines}</custom></mujoco>"))
    rows = np.arange(0.0, LASTS_S + 0.1, ROW_S)
    servo.write_text("time_s,servo_rad\n" + "".join(f"{t:.4f},{a:.9f}\n" for t, a in zip(rows, told(rows))))
    command = [rig, "simulate", model, "--out", out, f"--every-s={EVERY_S}", f"--accuracy-m={ACCURACY_M}", f"--duration-s={LASTS_S}",
               "--qpos=" + ",".join(repr(float(q)) for q in pose)]
    if run.kind == "driven" or not mechanism.led:
        command += ["--servo", servo]
    if run.kind == "driven" and mechanism.led:
        command.append("--prescribed")
    subprocess.run([str(word) for word in command], check=True, capture_output=True)
    with open(out, newline="") as file:
        table = list(csv.DictReader(file))
    names = [f"P{k + 1}_{axis}_m" for k in range(mechanism.links) for axis in "xz"]
    seen = np.array([[float(row[name]) for name in names] for row in table])
    return np.array([float(row["time_s"]) for row in table]), seen.reshape(len(table), -1, 2)


def compare(rig, case, place, folder):
    """What the cause does, and by how much the two differ without and with it [mm]."""
    run, seen = case.runs[place], []
    for hidden in ({}, case.faults[0].at(run.name)):
        tank = Tank(case.mechanism, hidden, case.step_s)
        if run.kind == "drop":
            moved = tank.move(0.0, LASTS_S + MARGIN_S, held=case.poses[place])
        else:
            moved = tank.move(0.0, LASTS_S + MARGIN_S, stroke=case.strokes[place])
        times, theirs = simulated(rig, case, place, hidden, tank.first_pose, folder)
        inside = (times > MARGIN_S) & (times < LASTS_S - MARGIN_S)
        seen.append((tank.look(*moved, times)[inside], theirs[inside]))
    far = lambda a, b: 1e3 * np.abs(a - b).max()
    return far(seen[1][0], seen[0][0]), far(*seen[0]), far(*seen[1])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("causes", nargs="*", metavar="CAUSE")
    parser.add_argument("--rig", default="rig")
    options = parser.parse_args()
    print(f"{'cause':20} {'run':9} {'effect':>9} {'plain':>9} {'hidden':>9}   mm")
    for index, cause in enumerate(ORDINARY):
        if cause in NOT_IN_SIMULATE or options.causes and cause not in options.causes:
            continue
        case = Case("one", index)
        with tempfile.TemporaryDirectory() as folder:
            for place in (0, 2):
                effect, plain, hidden = compare(options.rig, case, place, Path(folder))
                print(f"{cause:20} {case.runs[place].name:9} {effect:9.4f} {plain:9.4f} {hidden:9.4f}", flush=True)


if __name__ == "__main__":
    main()
