"""What the scripts of this folder share: tables and experiment files as `rig` reads them, and the scores of a fit."""

import json
import math
import pathlib
import sys

# an encoder's angle counts as the way of a pointer of this length in fit.json [m]
POINTER_M = 0.125


def folders(usage):
    """The data's folder and the one to write to, from the command line."""
    if len(sys.argv) != 3:
        sys.exit(usage)
    data, out = map(pathlib.Path, sys.argv[1:])
    if not data.is_dir():
        sys.exit(f"{data} is no folder; name the one with the recordings")
    out.mkdir(parents=True, exist_ok=True)
    return data, out


def write_table(path, titles, rows, head=""):
    """A table with a gap for each None."""
    cells = lambda row: ",".join("" if value is None else repr(float(value)) for value in row)
    path.write_text(head + ",".join(titles) + "\n" + "".join(cells(row) + "\n" for row in rows))


def run(name, **keys):
    """One [[run]] of an experiment file."""
    lines = [f"[[run]]\nid = {json.dumps(name)}"]
    lines += [f"{key} = {value if isinstance(value, (int, float)) or key == 'times' else json.dumps(value)}" for key, value in keys.items()]
    return "\n".join(lines) + "\n"


def scores(folder):
    """Of each run of the fit in `folder`: id, use, and by mark the mean and the rms error [m]."""
    fit = json.loads((pathlib.Path(folder) / "fit.json").read_text())
    for one in fit["runs"]:
        marks = {mark["name"]: (mark["mean_error_m"], mark["rms_error_m"]) for mark in one["keypoints"]}
        yield one["id"], one["use"], marks


def degrees(pointer_m):
    """An encoder's error in degrees."""
    return math.degrees(pointer_m / POINTER_M)
