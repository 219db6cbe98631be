"""Mean errors of the angle over the records of each gain that was held out: python3 xl330_scores.py OUT"""

import pathlib
import sys

from tables import degrees, scores

means = []
for folder in sorted(pathlib.Path(sys.argv[1]).glob("fit-*")):
    for name, use, marks in scores(folder):
        mean = degrees(marks["horn_rad"][0])
        print(f"{folder.name:10} {use:8} {name:24} {mean:6.2f} degrees")
        if use == "holdout":
            means.append(mean)
print(f"held out, mean of {len(means)} records: {sum(means) / len(means):.2f} degrees")
