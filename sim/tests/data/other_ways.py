"""Writes other_ways.json: the same things written in other ways than ours, and how MuJoCo moves them. Needs mujoco and numpy.

python3 other_ways.py > other_ways.json"""
import json
import sys
import tempfile
from pathlib import Path

import mujoco
import numpy as np

WATER = 'density="1000" viscosity="0.001"'
ROD = '<geom type="capsule" fromto="0 0 0 0.2 0 0" size="0.02"/>'
ARM = f'<body name="a" pos="0 0 1"><joint name="j" axis="0 1 0" {{joint}}/>{ROD}<body name="b" pos="0.2 0 0"><joint name="k" axis="0 1 0.2"/>{ROD}</body></body>'
HULL = '<geom type="ellipsoid" size="0.1 0.05 0.02" pos="0.01 0.02 0" fluidshape="ellipsoid" fluidcoef="0.6 0.2 1.1 0.8 0.9"/>'


def model(world, option="", **sections):
    sections = {"option": option, "worldbody": f"<worldbody>{world}</worldbody>"} | sections
    return "<mujoco>" + "".join(sections.values()) + "</mujoco>"


def saved(xml):
    """What MuJoCo itself writes of it."""
    with tempfile.TemporaryDirectory() as folder:
        path = str(Path(folder) / "saved.xml")
        mujoco.mj_saveLastXML(path, mujoco.MjModel.from_xml_string(xml))
        return Path(path).read_text()


def drives(*elements):
    return "<actuator>" + "".join(elements) + "</actuator>"


def arm(joint="", **sections):
    return model(ARM.format(joint=joint), **sections)


SERVOS = drives('<position name="p" joint="j" kp="3" kv="0.1" forcerange="-1 1"/>', '<velocity joint="k" kv="0.2"/>', '<motor joint="k" gear="2"/>')
GENERAL = drives(
    '<general joint="j" gainprm="2" biastype="affine" biasprm="0 -2 -0.1" gear="1.5"/>',
    '<general joint="k" gainprm="0.3" biastype="affine" biasprm="0 0 -0.3"/>',
    '<general joint="k" gainprm="-0.5" forcerange="-0.04 0.1" biasprm="1 2 3"/>')
INHERITED = '<default><general gainprm="5" biasprm="1 -2 -0.3" biastype="affine"/><default class="v"><velocity kv="0.4"/></default></default>'
MESH = '<asset><mesh name="m" vertex="0 0 0 0.1 0 0 0 0.1 0 0 0 0.1"/></asset>'
TENDONS = ('<tendon><fixed name="t" stiffness="3 1 2" damping="0.02 0.01 0.001" springlength="-0.1 0.05"><joint joint="j" coef="0.5"/><joint joint="k" coef="-2"/></fixed>'
           '<fixed name="u" stiffness="1"><joint joint="k" coef="1.5"/></fixed><fixed name="v"><joint joint="j" coef="-1"/><joint joint="k" coef="0.3"/></fixed></tendon>')
CASES = {
    "tendons": arm('springref="10"', tendon=TENDONS, actuator=drives('<position tendon="t" kp="3" kv="0.1" gear="0.7" forcerange="-0.3 1"/>', '<general tendon="v" gainprm="-2"/>')),
    "tendons, implicitfast": arm(option='<option integrator="implicitfast"/>', tendon=TENDONS.replace('damping="0.02 0.01 0.001"', ""), actuator=drives('<motor tendon="v"/>')),
    "saved servos": saved(arm('damping="0.01" range="-60 80"', option=f"<option {WATER}/>", actuator=SERVOS)),
    "general": arm(actuator=GENERAL),
    "inherited laws": arm(default=INHERITED, actuator=drives('<position joint="j"/>', '<motor joint="k"/>', '<position joint="k" class="v"/>')),
    "frame": model(f'<frame pos="0 0.1 1" euler="10 20 30"><body><frame pos="0.1 0 0" axisangle="1 1 0 40"><joint axis="0 1 0" pos="0 0 0.02"/>{ROD}</frame>'
                   f'<frame euler="0 0 50"><body pos="0.2 0 0"><joint axis="1 0 0"/>{ROD}</body></frame></body></frame>', f"<option {WATER}/>"),
    "replicate": model(f'<body name="hub"><joint axis="0 0 1"/>{ROD}<replicate count="10" offset="0 0 0.1" euler="0 0 36" sep="-">'
                       f'<body name="a" pos="0.3 0 0"><joint name="j" axis="0 1 0"/><replicate count="2" offset="0 0.01 0">{ROD}</replicate></body></replicate></body>'
                       f'<body name="last" pos="0 0 2"><joint axis="1 0 0"/>{ROD}</body>'),
    "what only draws": model(f'<body><joint name="j" axis="0 1 0"/>{ROD}<site name="s"/><geom type="mesh" mesh="m" mass="0" contype="0" conaffinity="0"/></body>', asset=MESH,
                             tendon='<tendon><spatial><site site="s"/><site site="t"/></spatial><fixed><joint joint="j" coef="2"/></fixed></tendon>',
                             equality='<equality><joint joint1="j" active="false"/></equality>').replace("<worldbody>", '<worldbody><site name="t" pos="1 0 0"/>'),
    "mesh and inertial": model('<body><joint axis="0 1 0"/><inertial pos="0.1 0 0" mass="1" diaginertia="0.01 0.01 0.01"/><geom type="mesh" mesh="m" contype="0" conaffinity="0"/></body>', asset=MESH),
    "no gravity": arm(option=f'<option {WATER}><flag gravity="disable"/></option>'),
    "no constraint": arm('range="-1 1" frictionloss="0.1"', option='<option><flag constraint="disable"/></option>'),
    "no clamping": arm(actuator=drives('<motor joint="j" ctrlrange="-0.01 0.01"/>'), option='<option><flag clampctrl="disable"/></option>'),
    "soft end stop": arm('range="-5 0" solreflimit="0.05 0.7" solimplimit="0.5 0.99 0.1 0.3 3" margin="0.02"'),
    "stiff end stop": arm('range="-5 0" solreflimit="-2000 -30" solimplimit="0.8 0.8 0.01"'),
    "soft friction": arm('frictionloss="0.3" solreffriction="0.04 1" solimpfriction="0.7 0.9 0.001"'),
    "masses": arm(compiler='<compiler settotalmass="3" boundmass="0.26" boundinertia="0.001" inertiagrouprange="0 1"/>').replace('size="0.02"/></body>', 'size="0.02"/><geom group="2" size="0.1"/></body>', 1),
    "lone free body": model(f'<body><freejoint/>{HULL}</body>', f'<option {WATER} integrator="implicitfast"/>'),
    "lone in vacuum": model(f'<body><freejoint/>{HULL}</body><body pos="1 0 0"><freejoint/><geom type="box" size="0.1 0.02 0.05" pos="0 0.1 0"/></body>'
                            + ARM.format(joint='damping="0.1"'), '<option integrator="implicitfast"/>'),
    "lone with weights": model(f'<body><freejoint/>{HULL}<body pos="0 0.1 0.1" euler="10 30 0">{HULL}<body pos="0.1 0 0">{ROD}</body></body></body>', f'<option {WATER} integrator="implicitfast"/>'),
    "implicit": model(f'<body><freejoint/>{HULL}</body>', f'<option {WATER} integrator="implicit"/>'),
}


def main():
    rng, out = np.random.default_rng(47), []
    for name, xml in CASES.items():
        m = mujoco.MjModel.from_xml_string(xml)
        m.opt.tolerance, m.opt.iterations, m.opt.ls_tolerance = 0, 200, 1e-14
        d = mujoco.MjData(m)
        mujoco.mj_integratePos(m, d.qpos, rng.normal(0, 0.2, m.nv), 1.0)
        d.qvel[:], d.ctrl[:] = rng.normal(0, 1, m.nv), rng.normal(0, 0.2, m.nu)
        case = {"name": name, "xml": xml, "qpos": d.qpos.tolist(), "qvel": d.qvel.tolist(), "ctrl": d.ctrl.tolist(), "steps": 250}
        for _ in range(case["steps"]):
            mujoco.mj_step(m, d)
        out.append(case | {"joints": [m.joint(i).name for i in range(m.njnt)], "after": {"qpos": d.qpos.tolist(), "qvel": d.qvel.tolist()}})
    json.dump(out, sys.stdout, indent=0)
    print()


if __name__ == "__main__":
    main()
