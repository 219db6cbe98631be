"""Writes contact_points.json and contact_runs.json: where MuJoCo finds pairs of shapes in contact, and how mechanisms that touch
move in MuJoCo. Needs mujoco and numpy.

python3 contact.py"""
import json
import pathlib

import mujoco
import numpy as np

from random_models import COUNT, element, nums

HERE = pathlib.Path(__file__).parent
CONFIGS = HERE.parents[2] / "configs" / "models"
PAIRS = [("plane", "sphere"), ("plane", "capsule"), ("plane", "ellipsoid"), ("plane", "cylinder"), ("plane", "box"),
         ("sphere", "sphere"), ("sphere", "capsule"), ("capsule", "capsule"), ("box", "box")]
EACH_S = 0.005


def placed(rng, name, shape, flat):
    if shape == "plane":
        return element("geom", {"name": name, "type": shape, "size": "1 1 1", "quat": nums(rng.normal(0, 1, 4))})
    quat = rng.normal(0, 1, 4)
    if flat:
        # parallel or square to the other one: faces on faces, edges on edges
        quat = np.round(rng.uniform(-1, 1, 4))
        quat = quat if quat.any() else np.array([1.0, 0, 0, 0])
    return element("geom", {"name": name, "type": shape, "size": nums(rng.uniform(0.01, 0.03, COUNT[shape])),
                            "quat": nums(quat), "margin": nums(rng.choice([0, 0.004]))})


def points():
    """Pairs at random poses that touch, with every contact point."""
    rng = np.random.default_rng(27)
    cases = []
    for first, second in PAIRS:
        kept = 0
        while kept < (30 if first == "box" else 10):
            flat = rng.random() < 0.3
            at = nums(rng.normal(0, 0.02, 3))
            one = placed(rng, "first", first, flat)
            one = one if first == "plane" else f'<body><freejoint/>{one}</body>'
            xml = (f'<mujoco><worldbody>{one}<body pos="{at}"><freejoint/>{placed(rng, "second", second, flat)}</body>'
                   '</worldbody></mujoco>')
            m = mujoco.MjModel.from_xml_string(xml)
            d = mujoco.MjData(m)
            mujoco.mj_forward(m, d)
            if not d.ncon:
                continue
            cases.append({"shapes": [first, second], "xml": xml, "points": [
                {"at_m": c.pos.tolist(), "normal": c.frame[:3].tolist(), "distance_m": float(c.dist)} for c in d.contact]})
            kept += 1
    return cases


def falling(shape, size, cone, more="", option="", turn="1 0.3 0.2 0.1"):
    """A shape that sinks in water onto a floor."""
    return (f'<mujoco><option timestep="0.001" integrator="Euler" density="1000" viscosity="0.00095" cone="{cone}" {option} '
            'tolerance="0" iterations="100" ls_iterations="100" ls_tolerance="1e-10"/>'
            f'<worldbody><geom name="floor" type="plane" size="1 1 1"/><body pos="0 0 0.05" quat="{turn}"><freejoint/>'
            f'<geom name="shape" type="{shape}" size="{size}" density="2500" fluidshape="ellipsoid" {more}/>'
            '<site name="centre"/><site name="aside" pos="0.02 0.01 0.015"/></body></worldbody></mujoco>')


def chain(name, option='tolerance="0" iterations="100" ls_iterations="100"', extra="", joint=""):
    """A three-link mechanism as configured, its links no longer passing through each other."""
    text = (CONFIGS / name).read_text().replace('contype="0" conaffinity="0"', 'contype="1" conaffinity="1"')
    text = text.replace("<option ", f"<option {option} ").replace("<worldbody>", f"<worldbody>{extra}")
    return text.replace('<joint type="hinge"', f'<joint type="hinge" {joint}') if joint else text


def run(name, xml, qpos=None, qvel=None, last_s=0.6):
    """Where the sites are every 5 ms, and when the first contact begins and ends."""
    m = mujoco.MjModel.from_xml_string(xml)
    d = mujoco.MjData(m)
    if qpos is not None:
        d.qpos[:] = qpos
    if qvel is not None:
        d.qvel[:] = qvel
    start = {"qpos": d.qpos.tolist(), "qvel": d.qvel.tolist()}
    begin = end = None
    times, sites = [], []
    every = round(EACH_S / m.opt.timestep)
    for k in range(round(last_s / m.opt.timestep) + 1):
        mujoco.mj_forward(m, d)
        if begin is None and d.nefc and d.ncon:
            begin = d.time
        if begin is not None and end is None and not d.ncon:
            end = d.time
        if k % every == 0:
            times.append(round(d.time, 9))
            sites.append(d.site_xpos.ravel().tolist())
        mujoco.mj_step(m, d)
    assert begin is not None, name
    end = end or last_s
    print(f"{name}: first contact from {begin:.3f} to {end:.3f} s")
    return {"name": name, "xml": xml, **start, "contact_s": [begin, end], "time_s": times, "sites": sites}


def runs():
    wall = '<geom name="wall" type="plane" size="1 1 1" pos="0.02 0 0" zaxis="-1 0 1" contype="1" conaffinity="1"/>'
    pair = ('<mujoco><option timestep="0.001" gravity="0 0 0" cone="{cone}" tolerance="0" iterations="100"/><worldbody>'
            '<body><freejoint/><geom name="one" type="{a}" size="0.01 0.02" margin="0.002" gap="0.001"/><site name="s1" '
            'pos="0.01 0.02 0"/></body><body pos="0.004 0.05 0.003" quat="1 0.5 0.2 0"><freejoint/><geom name="two" type="{b}" '
            'size="0.012 0.015" friction="0.4"/><site name="s2" pos="0 0.01 0.02"/></body></worldbody></mujoco>')
    towards = [0, 0.2, 0.0, 1, 0, 2, 0, -0.2, 0.05, 0, 1, 0]
    return [
        run("capsule on the floor", falling("capsule", "0.008 0.02", "pyramidal")),
        run("box on the floor", falling("box", "0.015 0.01 0.02", "pyramidal")),
        run("ellipsoid on the floor, elliptic cone", falling("ellipsoid", "0.015 0.01 0.02", "elliptic")),
        run("cylinder on the floor, elliptic cone, spinning friction",
            falling("cylinder", "0.012 0.02", "elliptic", 'condim="4" friction="0.6 0.01"', 'impratio="4"')),
        run("sphere on the floor, rolling friction, soft",
            falling("sphere", "0.012", "pyramidal", 'condim="6" priority="1" friction="0.8 0.004 0.0005" '
                    'solref="-4000 -60" solimp="0.8 0.98 0.002 0.3 3" margin="0.001"'),
            qpos=[0, 0, 0.03, 1, 0, 0, 0], qvel=[0.3, 0.1, 0, 0, 5, 30]),
        run("box on the floor without friction",
            falling("box", "0.015 0.01 0.02", "elliptic", 'condim="1"')),
        run("spheres", pair.format(cone="elliptic", a="sphere", b="sphere"), qvel=towards, last_s=0.3),
        run("sphere and capsule", pair.format(cone="pyramidal", a="sphere", b="capsule"), qvel=towards, last_s=0.3),
        run("capsules", pair.format(cone="elliptic", a="capsule", b="capsule"), qvel=towards, last_s=0.3),
        run("three links folded, end on side", chain("chain-passive.xml"), qpos=[0.2, 2.3, 1.6], qvel=[0, 0, 4]),
        run("three links folded flat", chain("chain-passive.xml"), qpos=[0.5, 2.9, 0.25], qvel=[0, 0, 0]),
        run("three links in a horizontal plane", chain("chain-driven-flat.xml"), qpos=[0, 2.4, 2.0], qvel=[0, 0, 3]),
        run("three links against a wall", chain("chain-passive.xml", extra=wall), qpos=[-1.2, 0, 0]),
        run("three links against a wall and their end stops",
            chain("chain-passive.xml", extra=wall, joint='range="-1.3 0.02" solreflimit="0.02 1"'), qpos=[-1.2, 0, 0]),
        run("three links against a wall, implicitfast",
            chain("chain-passive.xml", extra=wall).replace('integrator="Euler"', 'integrator="implicitfast"'),
            qpos=[-1.2, 0, 0]),
        run("three links against a wall, Runge-Kutta, elliptic cone",
            chain("chain-passive.xml", extra=wall).replace('integrator="Euler"', 'integrator="RK4" cone="elliptic"'),
            qpos=[-1.2, 0, 0]),
    ]


def main():
    for name, cases in [("contact_points", points()), ("contact_runs", runs())]:
        (HERE / f"{name}.json").write_text(json.dumps(cases, separators=(",", ":")) + "\n")


if __name__ == "__main__":
    main()
