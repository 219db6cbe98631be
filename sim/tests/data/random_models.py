"""Writes random_models.json: random trees, and how MuJoCo moves them. Needs mujoco and numpy.

python3 random_models.py > random_models.json"""
import json
import sys

import mujoco
import numpy as np

SHAPES = ("sphere", "capsule", "cylinder", "ellipsoid", "box")
COUNT = {"sphere": 1, "capsule": 2, "cylinder": 2, "ellipsoid": 3, "box": 3}
NUDGE = 1e-12
INTEGRATORS = ("Euler", "implicitfast", "RK4")


def nums(values):
    return " ".join(f"{v:.6g}" for v in np.atleast_1d(values))


def joint(rng, name, kind, features):
    a = {"name": name, "type": kind}
    if kind != "free":
        a["pos"] = nums(rng.normal(0, 0.01, 3))
    single = kind in ("hinge", "slide")
    if single:
        a["axis"] = nums(rng.normal(0, 1, 3))
    scale = 0.05 if kind == "slide" else 1e-3
    if rng.random() < 0.5:
        k = rng.uniform(0.2, 1) * scale * 20
        a["stiffness"] = nums([k, 0.5 * k, 0.3 * k] if single and rng.random() < 0.5 else k)
        if single:
            a["springref"] = nums(rng.normal(0, 0.2 if kind == "hinge" else 0.01))
    if rng.random() < 0.6:
        b = rng.uniform(0.2, 1) * scale
        a["damping"] = nums([b, 0.3 * b, 0.1 * b] if single and rng.random() < 0.4 else b)
    if rng.random() < 0.4:
        a["armature"] = nums(rng.uniform(0, 1e-4))
    if single and rng.random() < 0.3:
        a["ref"] = nums(rng.normal(0, 0.1 if kind == "hinge" else 0.01))
    if "friction" in features and rng.random() < 0.6:
        a["frictionloss"] = nums(rng.uniform(0.1, 1) * scale)
    if "limits" in features and single and rng.random() < 0.6:
        w = 0.3 if kind == "hinge" else 0.01
        a["range"] = nums([-w, w])
    return a


def element(tag, attributes):
    return f"<{tag} " + " ".join(f'{k}="{v}"' for k, v in attributes.items()) + "/>"


def geom(rng, features):
    shape = rng.choice(SHAPES)
    a = {"type": shape, "size": nums(rng.uniform(0.005, 0.02, COUNT[shape])), "pos": nums(rng.normal(0, 0.01, 3)),
         "quat": nums(rng.normal(0, 1, 4)), "density": nums(rng.uniform(800, 3000))}
    if shape in ("capsule", "cylinder") and rng.random() < 0.3:
        del a["pos"], a["quat"]
        a["size"], a["fromto"] = nums(rng.uniform(0.005, 0.02)), nums(rng.normal(0, 0.02, 6))
    if "ellipsoid" in features and rng.random() < 0.7:
        a["fluidshape"], a["fluidcoef"] = "ellipsoid", nums(rng.uniform(0, 2, 5))
    return element("geom", a)


def tree(rng, features, integrator):
    n = int(rng.integers(1, 13))
    children = {i: [] for i in range(-1, n)}
    for i in range(n):
        children[int(rng.integers(-1, i)) if i else -1].append(i)
    joints = []

    def body(i, top):
        a = {"pos": nums(rng.normal(0, 0.03, 3)), "quat": nums(rng.normal(0, 1, 4))}
        if rng.random() < 0.5:
            a["gravcomp"] = nums(rng.uniform(0, 1.2))
        out = f'<body name="b{i}" ' + " ".join(f'{k}="{v}"' for k, v in a.items()) + ">"
        if top and "free" in features and rng.random() < 0.6:
            kinds = ["free"]
        elif rng.random() < 0.15:
            kinds = ["ball"]
        else:
            kinds = list(rng.choice(("hinge", "hinge", "slide"), int(rng.integers(1, 3))))
        for kind in kinds:
            joints.append((f"j{len(joints)}", kind))
            out += element("joint", joint(rng, *joints[-1], features))
        if rng.random() < 0.2:
            out += element("inertial", {"pos": nums(rng.normal(0, 0.01, 3)), "mass": nums(rng.uniform(0.01, 0.1)),
                                        "diaginertia": nums(rng.uniform(1, 1.8, 3) * 1e-5), "quat": nums(rng.normal(0, 1, 4))})
        out += "".join(geom(rng, features) for _ in range(int(rng.integers(1, 3))))
        out += element("site", {"name": f"s{i}", "pos": nums(rng.normal(0, 0.03, 3))})
        return out + "".join(body(c, False) for c in children[i]) + "</body>"

    world = "".join(body(c, True) for c in children[-1])
    drives = ""
    for name, kind in joints:
        if kind in ("hinge", "slide") and "drives" in features and rng.random() < 0.5:
            tag = rng.choice(("position", "velocity", "motor"))
            a = {"name": f"d{name}", "joint": name, "gear": nums(rng.uniform(0.5, 2))}
            scale = 5.0 if kind == "slide" else 0.02
            if tag == "position":
                a["kp"], a["kv"] = nums(scale * rng.uniform(0.5, 2)), nums(scale * rng.uniform(0, 0.02))
            if tag == "velocity":
                a["kv"] = nums(scale * rng.uniform(0.005, 0.02))
            if rng.random() < 0.5:
                a["forcerange"] = nums(np.array([-0.1, 0.1]) * scale)
            if rng.random() < 0.5:
                a["ctrlrange"] = "-0.2 0.15"
            drives += element(tag, a)
    water = ' density="1000" viscosity="0.002"' if "water" in features else ""
    wind = ' wind="0.05 -0.1 0.02"' if "wind" in features else ""
    return (f'<mujoco><compiler angle="radian"/><option timestep="0.001" integrator="{integrator}" gravity="1 -0.5 -9.81"{water}{wind}/>'
            f'<default><geom contype="0" conaffinity="0"/></default>'
            f"<worldbody>{world}</worldbody><actuator>{drives}</actuator></mujoco>")


FEATURES = (set(), {"water"}, {"water", "ellipsoid"}, {"water", "ellipsoid", "wind", "drives"}, {"free", "water", "ellipsoid"},
            {"free", "water", "ellipsoid", "drives", "wind"}, {"friction", "water", "ellipsoid"}, {"limits", "drives", "water"},
            {"friction", "limits", "free", "drives", "water", "ellipsoid"})


def main():
    rng = np.random.default_rng(2026)
    cases = []
    while len(cases) < 54:
        features, integrator = FEATURES[len(cases) % 9], INTEGRATORS[len(cases) // 9 % 3]
        m = mujoco.MjModel.from_xml_string(xml := tree(rng, features, integrator))
        # implicitfast treats the rotation of a lone free body apart in MuJoCo: other_ways.py has those
        lone = any(m.jnt_type[j] == 0 and (m.body_treeid == m.body_treeid[m.jnt_bodyid[j]]).sum() == 1 for j in range(m.njnt))
        if m.nv == 0 or (integrator == "implicitfast" and lone):
            continue
        m.opt.tolerance, m.opt.iterations, m.opt.ls_tolerance = 0, 200, 1e-12
        d = mujoco.MjData(m)
        mujoco.mj_integratePos(m, d.qpos, rng.normal(0, 0.2, m.nv), 1.0)
        d.qvel[:] = rng.normal(0, 1, m.nv)
        d.ctrl[:] = rng.normal(0, 0.2, m.nu)
        case = {"features": sorted(features), "xml": xml, "qpos": d.qpos.tolist(), "qvel": d.qvel.tolist(), "ctrl": d.ctrl.tolist()}
        mujoco.mj_forward(m, d)
        case["qacc"] = d.qacc.tolist()
        # how far MuJoCo leads itself astray when it starts a rounding error aside
        other = mujoco.MjData(m)
        other.qpos[:], other.qvel[:], other.ctrl[:] = d.qpos, d.qvel * (1 + NUDGE), d.ctrl
        for steps in (1, 100, 1000):
            while round(d.time / 0.001) < steps and np.abs(d.qvel).max() < 100:
                mujoco.mj_step(m, d)
                mujoco.mj_step(m, other)
            case[f"after_{steps}"] = {"qpos": d.qpos.tolist(), "qvel": d.qvel.tolist()}
        case["growth"] = max(np.abs(a - b).max() / np.abs(b).max() for a, b in ((other.qpos, d.qpos), (other.qvel, d.qvel))) / NUDGE
        # models that fly apart, and those whose motion is chance, tell nothing
        if np.abs(d.qvel).max() < 100 and case["growth"] < 1e4:
            cases.append(case)
    json.dump(cases, sys.stdout, separators=(",", ":"))
    print()


if __name__ == "__main__":
    main()
