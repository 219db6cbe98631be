"""The laws of `rig` for servos, motors and gears on real recordings, by a small simulation of its own (independent.c): a check on both.

    python3 independent.py xl330 DATA       # mean errors of the angle, each gain held out in turn
    python3 independent.py emps DATA        # rms errors, estimation and validation
    python3 independent.py pendulum DATA    # rms errors by joint, every second record held out, anew every half second

Needs a C compiler, numpy and scipy.
"""

import csv
import ctypes
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from scipy.optimize import least_squares

NUMBERS = np.ctypeslib.ndpointer(np.float64, flags="C")


def compiled():
    """independent.c as a library."""
    library = pathlib.Path(tempfile.mkdtemp()) / "independent.so"
    source = pathlib.Path(__file__).with_suffix(".c")
    subprocess.run(["cc", "-O2", "-shared", "-fPIC", source, "-o", library, "-lm"], check=True)
    library = ctypes.CDLL(str(library))
    library.servo.argtypes = [NUMBERS, ctypes.c_int] + 3 * [NUMBERS] + 2 * [ctypes.c_double] + [NUMBERS]
    library.axis.argtypes = [NUMBERS, ctypes.c_int, ctypes.c_double, NUMBERS] + 2 * [ctypes.c_double] + [NUMBERS]
    library.pendulum.argtypes = [NUMBERS, ctypes.c_int, NUMBERS, NUMBERS] + 4 * [ctypes.c_double] + [NUMBERS]
    library.servo.restype = library.axis.restype = library.pendulum.restype = None
    return library


def fit(errors, start, scale, lower, upper, **options):
    """The numbers at which `errors` of them are least, sought in units of `scale`."""
    start, scale, lower, upper = (np.array(numbers, float) for numbers in (start, scale, lower, upper))
    residual = lambda units: np.nan_to_num(errors(units * scale), nan=10.0)
    return scale * least_squares(residual, start / scale, bounds=(lower / scale, upper / scale), **options).x


def xl330(library, data):
    names = ["armature", "gain", "viscous", "braking", "dry", "driving", "driven", "delay", "zero", "bar"]
    start = [0.002, 0.2, 0.015, 0.05, 0.02, 0.1, 0.1, 0.005, 0.0, 0.02]
    scale = [0.001, 0.05, 0.005, 0.02, 0.01, 0.1, 0.1, 0.005, 0.02, 0.02]
    lower = [1e-6] * 8 + [-0.2, 1e-6]
    upper = [0.05, 2.5, 0.25, 1.0, 0.5, 0.95, 5.0, 0.25, 1.0, 0.3]
    records = {}
    for path in sorted(data.glob("kp*.json")):
        record = json.loads(path.read_text())
        column = lambda key: np.array([float(entry[key]) for entry in record["entries"]])
        keys = ("timestamp", "goal_position", "torque_enable", "position")
        records[path.stem] = (float(record["kp"]), *map(column, keys))

    def errors(numbers, of):
        for name in of:
            gain, t, goal, on, angle = records[name]
            simulated = np.empty_like(t)
            library.servo(numbers, len(t), t, goal, on, gain, angle[0], simulated)
            yield simulated - angle

    held_out = []
    for gain in sorted({record[0] for record in records.values()}):
        fitted = [name for name, record in records.items() if record[0] != gain]
        others = [name for name, record in records.items() if record[0] == gain]
        together = lambda numbers: np.concatenate(list(errors(numbers, fitted)))
        found = fit(together, start, scale, lower, upper, loss="soft_l1", f_scale=0.05, max_nfev=40)
        print(f"without {gain:.0f}:", " ".join(f"{name} {value:.4g}" for name, value in zip(names, found)))
        for name, error in zip(others, errors(found, others)):
            held_out.append(np.degrees(np.abs(error).mean()))
            print(f"    {name:24} {held_out[-1]:.2f} degrees")
    print(f"held out, mean of {len(held_out)} records: {np.mean(held_out):.2f} degrees")


def emps(library, data):
    names = ["mass", "viscous", "dry", "offset", "Stribeck's share", "its rate", "driving", "driven"]
    start = [95.9, 218.0, 19.1, -3.3, 0.1, 0.01, 0.01, 0.01]
    scale = [10.0, 20.0, 2.0, 1.0, 0.2, 0.01, 0.05, 0.05]
    lower, upper = [1.0, 0.0, 0.0, -50.0, 0.0, 1e-4, 0.0, 0.0], [500.0, 1000.0, 100.0, 50.0, 10.0, 0.5, 0.95, 5.0]
    simple = 4

    def record(name):
        with open(data / f"{name}.csv") as file:
            rows = list(csv.DictReader(file))
        return (np.array([float(row[key]) for row in rows]) for key in ("time_s", "motor_N", "q_m"))

    def error(numbers, of, off_m=0.0, speed=0.0):
        _, force, place = of
        simulated = np.empty_like(place)
        library.axis(numbers, len(place), 1e-3, force, place[0] + off_m, speed, simulated)
        return simulated - place

    estimation, validation = (tuple(record(name)) for name in ("estimation", "validation"))
    rms_mm = lambda error: 1e3 * np.sqrt(np.mean(error**2))
    for count, what in ((simple, "without what the gear bears"), (len(names), "with it")):
        rest = [0.0, 0.0, 0.0, 0.0, 0.0, 0.01, 0.0, 0.0][count:]
        whole = lambda numbers: np.concatenate([numbers[:count], rest])
        # beside the numbers: how far off the start is, and how fast
        start_s = lambda numbers: (numbers[count], numbers[count + 1])
        misfit = lambda numbers: 1e3 * error(whole(numbers), estimation, *start_s(numbers))[::10]
        ends = lambda of, more: of[:count] + more
        found = fit(misfit, ends(start, [0, 0]), ends(scale, [1e-3, 1e-2]), ends(lower, [-0.05, -0.5]), ends(upper, [0.05, 0.5]), max_nfev=60)
        fitted = rms_mm(error(whole(found), estimation, *start_s(found)))
        print(f"{what}:", ", ".join(f"{name} {value:.4g}" for name, value in zip(names, found[:count])))
        # a parabola through the first 20 samples, which are not scored, says how the other record begins
        time, _, place = validation
        speed = np.polyfit(time[:20], place[:20], 2)[1]
        print(f"    estimation {fitted:.2f} mm, validation {rms_mm(error(whole(found), validation, 0.0, speed)[20:]):.2f} mm")


def pendulum(library, data):
    # as published in C0-model_3.0.yml; rotors geared 6:1 count 36 times
    names = ["inertia 1", "inertia 2", "coupling", "moment 1", "moment 2", "rotor 1", "rotor 2", "viscous 1", "viscous 2", "dry 1", "dry 2"]
    names += ["offset 1", "offset 2", "zero 1", "zero 2", "driving", "driven", "turns round over", "Stribeck's share", "its rate"]
    published = np.array([0.04927, 0.05388, 0.03623, 0.24113, 0.18118, 0.003577, 0.003577, 0.001, 0.001, 0.093, 0.078])
    published = np.concatenate([published, [0, 0, 0, 0, 0, 0, 0.05, 0, 0.5]])
    scale = np.concatenate([np.maximum(0.3 * published[:11], 0.02), [0.02] * 4, [0.1, 0.1, 0.02, 0.3, 0.2]])
    signed = np.isin(np.arange(20), range(11, 15))
    lower, upper = np.where(signed, -1.0, 1e-5), np.where(signed, 1.0, 3.0)
    upper[15] = 0.95
    piece_s, initial_s = 0.5, 0.1
    pieces = []
    for place, path in enumerate(sorted(data.glob("C0-[0-9]*.csv"))):
        table = np.genfromtxt(path, delimiter=",", names=True)
        columns = lambda name: np.ascontiguousarray(np.c_[table[f"{name}1"], table[f"{name}2"]])
        t, torque, angle = table["time"], columns("tau_meas"), columns("pos_meas")
        begin = t[0]
        while begin + initial_s + piece_s <= t[-1]:
            first, start, end = np.searchsorted(t, [begin, begin + initial_s, begin + initial_s + piece_s])
            # a cubic through the time before says where it is and how fast it goes
            ways = [np.polyfit(t[first : start + 1] - t[start], angle[first : start + 1, joint], 3) for joint in (0, 1)]
            state = [way[3] for way in ways] + [way[2] for way in ways]
            pieces.append((place, t[start:end].copy(), torque[start:end].copy(), angle[start:end].copy(), state))
            begin += piece_s

    def errors(numbers, wanted):
        for place, t, torque, angle, state in pieces:
            if wanted(place):
                simulated = np.empty_like(angle)
                library.pendulum(numbers, len(t), t, torque, *state, simulated)
                yield simulated - angle

    fitted, others = (lambda place: place % 2 == 1), (lambda place: place % 2 == 0)
    together = lambda numbers: np.concatenate([error[::5].ravel() for error in errors(numbers, fitted)])
    start = np.clip(published, lower + 1e-6, upper)
    found = fit(together, start, scale, lower, upper, loss="soft_l1", f_scale=0.05, max_nfev=40)
    print(", ".join(f"{name} {value:.4g}" for name, value in zip(names, found)))
    for what, numbers in (("published", published), ("fitted", found)):
        for of, wanted in (("fitted records", fitted), ("held-out records", others)):
            rms = np.degrees(np.sqrt(np.mean(np.concatenate(list(errors(numbers, wanted))) ** 2, axis=0)))
            print(f"{what:10} {of:17} shoulder {rms[0]:.2f}, elbow {rms[1]:.2f} degrees")
        for place in range(9):
            rms = np.degrees(np.sqrt(np.mean(np.concatenate(list(errors(numbers, lambda own: own == place))) ** 2, axis=0)))
            print(f"    record {place}: {rms[0]:.1f}, {rms[1]:.1f}")


if __name__ == "__main__":
    known = {"xl330": xl330, "emps": emps, "pendulum": pendulum}
    if len(sys.argv) != 3 or sys.argv[1] not in known:
        sys.exit(__doc__)
    known[sys.argv[1]](compiled(), pathlib.Path(sys.argv[2]))
