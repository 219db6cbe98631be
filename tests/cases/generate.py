#!/usr/bin/env python3
"""Writes experiments in which something is hidden, moved by MuJoCo. See README.md beside this file.

    generate.py OUT [--family NAME]... [--offset N] [--count N] [--share X]

OUT/case-NNNN holds what a user would hand in; OUT/hidden/case-NNNN.json says what is wrong. Needs `pip install mujoco numpy`.
"""

import argparse
import csv
import json
from pathlib import Path

import numpy as np

from descriptions import DESCRIPTIONS, TRACKERS, Run, describe_wrongly, track_badly
from faults import NEAR, ORDINARY, OUTSIDE, RUNS, draw, draw_by_run, draw_outside, draw_several
from mechanism import Mechanism
from score import GOLDEN
from servo import Stroke
from tank import Diverged, Tank

# Family: its first case's number and how many cases there are
FAMILIES = {"one": (1000, 40), "several": (2000, 30), "described": (3000, 40), "outside": (4000, 30), "by-run": (5000, 20),
            "trackers": (6000, 20), "nothing": (7000, 20)}
BY_RUN = ["buoyancy", "camera_offset", "camera_delay", "release_each"]
KINDS, KIND_SHARES = ["chain", "tails", "floating"], [0.6, 0.2, 0.2]
# A fault's shift of the keypoints in the fitted runs, rms over the noise: sizes are doubled or halved towards this range
VISIBLE = {"one": (0.8, 12.0), "several": (0.5, 6.0), "outside": (0.8, 10.0), "by-run": (0.8, 10.0)}
MOST_STEPS_OF_SIZE = 4
SHORTER = 0.25  # steps where MuJoCo's explicit ones diverge
WATCHED_S, MARGIN_S, ROW_S = 2.5, 0.4, 0.005


class Case:
    """Number `number` of a family, drawn from this number alone."""

    def __init__(self, family, index):
        self.family, self.index = family, index
        self.number = FAMILIES[family][0] + index
        streams = [np.random.default_rng([self.number, k]) for k in range(6)]
        setup, self.hiding, self.noise, self.spoiling, other, poses = streams
        self.mechanism = Mechanism(str(setup.choice(KINDS, p=KIND_SHARES)), setup)
        if family == "one" and ORDINARY[index % len(ORDINARY)] == "link_length" and not self.mechanism.long_links():
            self.mechanism = Mechanism("chain", setup)
        self.step_s = float(setup.choice([2.5e-4, 4e-4, 5e-4]))
        self.fps = float(setup.choice([50, 60, 75, 100]))
        self.noise_m, self.keep, self.white_share = setup.uniform(2.5e-4, 3.5e-4), setup.uniform(0.0, 0.5), 0.0
        self.grain_m = float(setup.choice([5e-5, 1e-4]))
        self.fits_damping = setup.random() < 0.75
        self.states_release = setup.random() < 0.75
        self.runs = [Run(name, kind, use, round(setup.uniform(0.15, 0.3), 4)) for name, kind, use in RUNS]
        self.phases = setup.uniform(0.0, 1.0, len(RUNS))
        self.strokes = [Stroke(setup.uniform(0.35, 0.7), setup.uniform(0.8, 1.5), run.start_s) for run in self.runs]
        self.poses = [self.mechanism.held(poses) for _ in RUNS]
        self.faults, self.description, self.outside, self.tracker = [], None, None, None
        self.mistake = self.bad_tracker = None
        self._hide()
        driven = [s for s, run in zip(self.strokes, self.runs) if run.kind == "driven"]
        assert len(driven) == 2
        if not self.fits_damping:
            self.mechanism.damping_factors[:] = 1.0
        if not self.mechanism.led:
            self.mechanism.damping_factors[0] = 1.0
        # a mechanism with as many keypoints, longer links and other water
        self.other = Mechanism(self.mechanism.kind, other)
        while self.other.links != self.mechanism.links or self.other.led != self.mechanism.led:
            self.other = Mechanism(self.mechanism.kind, other)
        self.other.length_m = self.mechanism.length_m * 1.12

    def _hide(self):
        """Draws what is wrong."""
        m, random, k = self.mechanism, self.hiding, self.index
        ordinary = lambda: draw(str(random.choice(["buoyancy", "coulomb_friction", "camera_offset", "servo_lag"])), m, self.strokes[2:], random)
        if self.family == "one":
            self.faults = [draw(ORDINARY[k % len(ORDINARY)], m, self.strokes[2:], random)]
        elif self.family == "several":
            self.faults = draw_several(m, self.strokes[2:], random)
        elif self.family == "described":
            self.mistake = DESCRIPTIONS[k % len(DESCRIPTIONS)]
            self.states_release |= self.mistake.startswith("release")
        elif self.family == "outside":
            self.outside = draw_outside(OUTSIDE[k % len(OUTSIDE)], m, random)
            if k // len(OUTSIDE) % 5 in (1, 3):
                self.faults = [ordinary()]
        elif self.family == "by-run":
            kind = BY_RUN[k % len(BY_RUN)]
            if kind == "release_each":
                self.mistake, self.states_release = kind, True
            else:
                self.faults = [draw_by_run(kind, m, random)]
            if k // len(BY_RUN) % 5 in (1, 3):
                self.faults.append(draw("servo_lag", m, self.strokes[2:], random))
        elif self.family == "trackers":
            self.bad_tracker = TRACKERS[k % len(TRACKERS)]
            if self.bad_tracker not in ("pose_bias", "slow_noise") and k // len(TRACKERS) % 5 in (1, 3):
                self.faults = [ordinary()]
            if self.bad_tracker == "quantised":
                self.noise_m, self.grain_m = 1.5e-4, float(random.uniform(5e-4, 9e-4))
            if self.bad_tracker == "slow_noise":
                self.keep, self.white_share = random.uniform(0.8, 0.95), random.uniform(0.4, 0.7)
        causes = {fault.cause for fault in self.faults}
        # a damping that is fitted is no candidate, and without a stated release the camera's clock and the servo's delay are one
        self.fits_damping &= "joint_damping" not in causes
        self.states_release |= bool(causes & {"camera_delay", "servo_delay"})

    def film(self, place, faults, mechanism=None):
        """Times of a run's images and what they would show without noise."""
        run, mechanism = self.runs[place], mechanism or self.mechanism
        hidden = {}
        for fault in faults:
            hidden.update(fault.at(run.name))
        if "outside/seed" in hidden:
            hidden["outside/seed"] += place
        tank = Tank(mechanism, hidden, self.step_s)
        end_s = run.start_s + WATCHED_S
        image_times = (np.arange(int(end_s * self.fps)) + self.phases[place]) / self.fps
        if run.kind == "drop":
            moved = tank.move(run.start_s, end_s + MARGIN_S, held=self.poses[place])
        else:
            moved = tank.move(0.0, end_s + MARGIN_S, stroke=self.strokes[place])
        return image_times, tank.look(*moved, image_times)

    def grow(self):
        """Brings each fault's size to where the fitted runs show it; says how much they do, over the noise."""
        limits = VISIBLE.get(self.family, VISIBLE["one"])
        fitted = [k for k, run in enumerate(self.runs) if run.use == "fit"]
        hiding = self.faults + ([self.outside] if self.outside else [])
        plain = {k: self.film(k, [])[1] for k in fitted} if hiding else {}
        grown, shifts = [], []
        for fault in hiding:
            for _ in range(MOST_STEPS_OF_SIZE):
                moved = [self.film(k, [fault])[1] - plain[k] for k in fitted]
                shift = np.sqrt(np.mean(np.concatenate([m.ravel() for m in moved]) ** 2)) / self.noise_m
                if limits[0] <= shift <= limits[1]:
                    break
                fault = fault.scaled(2.0 if shift < limits[0] else 0.5)
            grown.append(fault)
            shifts.append(round(float(shift), 2))
        if self.outside:
            self.outside = grown.pop()
        self.faults = grown
        return shifts

    def errors(self, shape):
        """Keypoint noise that correlates from image to image, with a white part beside where the tracker's memory is long."""
        slow = self.noise.standard_normal(shape)
        for k in range(1, len(slow)):
            slow[k] = self.keep * slow[k - 1] + np.sqrt(1 - self.keep**2) * slow[k]
        white = self.noise.standard_normal(shape)
        return self.noise_m * (np.sqrt(self.white_share) * white + np.sqrt(1 - self.white_share) * slow)

    def make(self):
        """Moves and films all runs; what is hidden, as a table."""
        shifts = self.grow()
        stranger = int(self.spoiling.integers(len(RUNS))) if self.mistake == "other_mechanism" else None
        for place, run in enumerate(self.runs):
            hiding = self.faults + ([self.outside] if self.outside else [])
            run.times, run.clean = self.film(place, hiding, self.other if place == stranger else None)
            run.seen = run.clean + self.errors(run.clean.shape)
            if run.kind == "drop" and self.states_release:
                run.stated_release_s = run.start_s
            if run.kind == "driven":
                rows = np.arange(0.0, run.start_s + WATCHED_S + MARGIN_S, ROW_S)
                run.servo = np.stack([rows, self.strokes[place].command(rows)], 1)
        if self.bad_tracker:
            self.tracker = track_badly(self.bad_tracker, self.runs, self.mechanism, self.spoiling)
        for run in self.runs:
            run.seen = np.round(run.seen / self.grain_m) * self.grain_m
        if self.mistake:
            self.description = describe_wrongly(self.mistake, self.runs, self.spoiling)
            if stranger is not None:
                self.description["runs"] = [self.runs[stranger].name]
        kind = self.outside and self.outside.cause.split("/")[1]
        m = self.mechanism
        return {
            "case": self.number,
            "family": self.family,
            "mechanism": {"kind": m.kind, "links": m.links, "led": m.led, "noise_m": self.noise_m, "noise_correlation": self.keep,
                          "images_per_s": self.fps},
            "faults": [fault.said(m) for fault in self.faults],
            "shift_over_noise": shifts,
            "description": self.description,
            "outside": self.outside and {"kind": kind, "near": NEAR.get(kind, []), "parameters": self.outside.values},
            "tracker": self.tracker,
        }

    def write(self, folder):
        """The files a user would hand in."""
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "model.xml").write_text(self.mechanism.mjcf())
        parameters = ["fluidcoef", "damping"] if self.fits_damping else ["fluidcoef"]
        lines = ['model = "model.xml"', f"prescribed = {str(self.mechanism.led).lower()}", "", "[fit]"]
        lines.append("parameters = " + json.dumps(parameters))
        for run in self.runs:
            lines += ["", "[[run]]", f'id = "{run.name}"', f'kind = "{run.kind}"', f'trajectory = "{run.name}.csv"']
            if run.servo is not None:
                lines.append(f'servo = "{run.name}-servo.csv"')
                write_table(folder / f"{run.name}-servo.csv", ["time_s", "servo_rad"], run.servo, [4, 6])
            if run.stated_release_s is not None:
                lines.append(f"release_s = {run.stated_release_s:.4f}")
            lines.append(f'use = "{run.use}"')
            count = run.seen.shape[1]
            seen = run.seen.reshape(len(run.seen), -1)
            header = ["time_s"] + [f"P{k + 1}_{axis}_m" for k in range(count) for axis in run.axes]
            write_table(folder / f"{run.name}.csv", header, np.column_stack([run.times, seen]), [5] + [6] * 2 * count)
        (folder / "experiment.toml").write_text("\n".join(lines) + "\n")


def write_table(path, header, rows, digits):
    """A CSV file; NaN is an empty cell."""
    with open(path, "w", newline="") as file:
        table = csv.writer(file, lineterminator="\n")
        table.writerow(header)
        for row in rows:
            table.writerow(["" if np.isnan(x) else f"{x:.{d}f}" for x, d in zip(row, digits)])


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("out", type=Path)
    parser.add_argument("--family", action="append", choices=FAMILIES)
    parser.add_argument("--offset", type=int, default=0, help="leave out so many cases of each family; beyond their number: unseen ones")
    parser.add_argument("--share", type=float, default=1.0, help="only the part that score.py --share goes through")
    parser.add_argument("--count", type=int, help="cases of each family; left out: its share of two hundred")
    options = parser.parse_args()
    (options.out / "hidden").mkdir(parents=True, exist_ok=True)
    for family in options.family or FAMILIES:
        count = FAMILIES[family][1] if options.count is None else options.count
        for index in range(options.offset, options.offset + count):
            name = f"case-{FAMILIES[family][0] + index}"
            said = options.out / "hidden" / f"{name}.json"
            if said.exists() or (FAMILIES[family][0] + index) * GOLDEN % 1.0 >= options.share:
                continue
            case = Case(family, index)
            try:
                hidden = case.make()
            except Diverged:
                # a stiff servo on light links
                case = Case(family, index)
                case.step_s *= SHORTER
                hidden = case.make()
            case.write(options.out / name)
            said.write_text(json.dumps(hidden, indent=1) + "\n")
            print(name, family, [f["cause"] for f in hidden["faults"]], hidden["shift_over_noise"], flush=True)


if __name__ == "__main__":
    main()
