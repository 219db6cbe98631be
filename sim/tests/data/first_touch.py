"""Writes first_touch.json: pairs of shapes that fly at each other, and when MuJoCo first finds them in contact. Needs mujoco
and numpy.

python3 first_touch.py > first_touch.json"""
import itertools
import json
import sys

import mujoco
import numpy as np

from random_models import COUNT, SHAPES, element, nums

STEPS = 600
LOOKS = 10  # MuJoCo looks at both ends of a step of 1 ms only: it is asked at so many shares of a step, on a straight way


def geom(rng, name, shape):
    if shape == "plane":
        return element("geom", {"name": name, "type": shape, "size": "1 1 1"})
    a = {"name": name, "type": shape, "size": nums(rng.uniform(0.01, 0.03, COUNT[shape])), "pos": nums(rng.normal(0, 0.01, 3)),
         "quat": nums(rng.normal(0, 1, 4))}
    if rng.random() < 0.25:
        a["margin"] = nums(rng.uniform(0, 0.005))
    return element("geom", a)


def model(rng, first, second):
    at = nums(rng.normal(0, 1, 4))
    one = geom(rng, "first", first)
    one = (f'<body name="a" pos="0 0 -0.05" quat="{at}">' + ("" if first == "plane" else "<freejoint/>") + one + "</body>"
           if first != "plane" else one)
    return (f'<mujoco><option timestep="0.001" integrator="Euler" gravity="0 0 0"/><worldbody>{one}'
            f'<body name="b" pos="0 0 0.1"><freejoint/>{geom(rng, "second", second)}</body></worldbody></mujoco>')


def first_contact(m, d):
    """Time at which two geoms are first closer than their margins, [s]; None when they never are."""
    step = m.opt.timestep / LOOKS
    m.opt.timestep = step
    for k in range(STEPS * LOOKS + 1):
        mujoco.mj_forward(m, d)
        for c in d.contact[: d.ncon]:
            if c.dist < sum(m.geom_margin[c.geom]):
                return k * step
        mujoco.mj_step(m, d)
    return None


def main():
    rng = np.random.default_rng(2026)
    cases = []
    kinds = list(itertools.combinations_with_replacement(SHAPES, 2)) + [("plane", shape) for shape in SHAPES]
    for first, second in kinds:
        kept = 0
        while kept < 3:
            xml = model(rng, first, second)
            m = mujoco.MjModel.from_xml_string(xml)
            d = mujoco.MjData(m)
            for body in range(m.nv // 6):
                towards = -1 if body == m.nv // 6 - 1 else 1
                d.qvel[6 * body: 6 * body + 3] = [*rng.normal(0, 0.03, 2), towards * rng.uniform(0.1, 0.3)]
                d.qvel[6 * body + 3: 6 * body + 6] = rng.normal(0, 4, 3)
            case = {"shapes": [str(first), str(second)], "xml": xml, "qpos": d.qpos.tolist(), "qvel": d.qvel.tolist()}
            case["time_s"] = first_contact(m, d)
            # at 0 there is no first touch; of those that pass each other a few will do
            if case["time_s"] == 0 or case["time_s"] is None and rng.random() < 0.7:
                continue
            cases.append(case)
            kept += 1
    print(f"{sum(c['time_s'] is None for c in cases)} of {len(cases)} never touch, MuJoCo {mujoco.__version__}", file=sys.stderr)
    print(json.dumps(cases, separators=(",", ":")))


if __name__ == "__main__":
    main()
