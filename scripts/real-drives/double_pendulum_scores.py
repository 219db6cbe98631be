"""Errors of both joints over the held-out records, fitted and published: python3 double_pendulum_scores.py OUT"""

import pathlib
import sys

from tables import degrees, scores

for fit in ("published", "fit"):
    squares = {}
    for name, use, marks in scores(pathlib.Path(sys.argv[1]) / fit):
        for joint in ("shoulder", "elbow"):
            squares.setdefault((name[:5], use, joint), []).append(degrees(marks[f"{joint}_rad"][1]) ** 2)
    for use in ("fit", "holdout"):
        for joint in ("shoulder", "elbow"):
            of = [square for key, all_of in squares.items() if key[1:] == (use, joint) for square in all_of]
            rms = (sum(of) / len(of)) ** 0.5
            by_record = " ".join(f"{key[0]} {(sum(all_of) / len(all_of)) ** 0.5:.2f}" for key, all_of in squares.items() if key[1:] == (use, joint))
            print(f"{fit:10} {use:8} {joint:9} {rms:6.2f} degrees rms    {by_record}")
