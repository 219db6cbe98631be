"""Records of a driven double pendulum (dfki-ric-underactuated-lab/double_pendulum) as experiments, in pieces that begin anew every half second.

    python3 double_pendulum.py DATA OUT
    rig fit OUT/fitted.toml --out OUT/fit             # odd records fitted, even ones held out
    rig fit OUT/published.toml --out OUT/published    # the authors' numbers on the same pieces
    python3 double_pendulum_scores.py OUT
"""

import csv

from tables import folders, run, write_table

# as published in C0-model_3.0.yml; rotors geared 6:1 count 36 times
MODEL = """<mujoco model="driven-double-pendulum">
  <compiler angle="radian"/>
  <option gravity="0 0 -9.81" timestep="0.001"/>
  <worldbody>
    <body name="upper">
      <joint name="shoulder" axis="0 -1 0" damping="0.001" armature="0.003577"/>
      <inertial pos="0 0 -0.2" mass="0.6416938" diaginertia="0.001043 0.001043 0.0001"/>
      <site name="P0" pos="0 0 0"/>
      <body name="lower" pos="0 0 -0.2">
        <joint name="elbow" axis="0 -1 0" damping="0.001" armature="0.003577"/>
        <inertial pos="0 0 -0.278" mass="0.563936" diaginertia="0.0103 0.0103 0.0001"/>
        <site name="P1" pos="0 0 0"/>
        <site name="P2" pos="0 0 -0.3"/>
      </body>
    </body>
  </worldbody>
  <actuator><motor name="m1" joint="shoulder"/><motor name="m2" joint="elbow"/></actuator>
  <custom>
    <numeric name="coulomb_friction/shoulder" data="0.093"/>
    <numeric name="coulomb_friction/elbow" data="0.078"/>
  </custom>
</mujoco>
"""

HEAD = """model = "pendulum.xml"
noise_m = 0.0005
[fit]
method = "least-squares"
"""
FITTED = """fixed = ["m1/gain", "m2/gain"]
parameters = ["upper/mass", "inertia/upper", "inertia/lower", "shoulder/armature", "elbow/armature", "shoulder/damping", "elbow/damping", "coulomb_friction/shoulder", "coulomb_friction/elbow", "coulomb_friction/rate", "coulomb_friction/breakaway", "coulomb_friction/stribeck_rate", "gear_friction/driving", "gear_friction/driven", "drive_offset/m1", "drive_offset/m2", "joint_zero/shoulder", "joint_zero/elbow"]
[fit.bounds]
"coulomb_friction/shoulder" = [0.0, 0.5]
"coulomb_friction/elbow" = [0.0, 0.5]
"""
# nothing that matters is free here
PUBLISHED = """parameters = ["coulomb_friction/shoulder", "coulomb_friction/elbow"]
[fit.bounds]
"coulomb_friction/shoulder" = [0.0929, 0.0931]
"coulomb_friction/elbow" = [0.0779, 0.0781]
"""

# each piece is predicted so long, after so much that only says how it begins [s]
PIECE_S, INITIAL_S = 0.5, 0.1
# every sample is an image
EVERY = 1


def pieces(name, path, out):
    """The pieces of one record, as tables: their names."""
    with open(path) as file:
        rows = [{key: float(value) for key, value in row.items()} for row in csv.DictReader(file)]
    torques = ([row["time"], row["tau_meas1"], row["tau_meas2"]] for row in rows)
    write_table(out / f"{name}-servo.csv", ["time_s", "m1_Nm", "m2_Nm"], torques)
    begin = rows[0]["time"]
    number = 0
    while begin + INITIAL_S + PIECE_S <= rows[-1]["time"]:
        inside = [row for row in rows if begin <= row["time"] <= begin + INITIAL_S + PIECE_S][::EVERY]
        angles = ([row["time"], row["pos_meas1"], row["pos_meas2"]] for row in inside)
        write_table(out / f"{name}-{number:02}.csv", ["time_s", "shoulder_rad", "elbow_rad"], angles)
        yield f"{name}-{number:02}"
        begin += PIECE_S
        number += 1


def main():
    data, out = folders(__doc__)
    runs = ""
    for place, path in enumerate(sorted(data.glob("C0-[0-9]*.csv"))):
        use = "fit" if place % 2 else "holdout"
        for piece in pieces(path.stem, path, out):
            keys = {"kind": "free", "init_s": INITIAL_S, "use": use}
            runs += run(piece, trajectory=f"{piece}.csv", servo=f"{path.stem}-servo.csv", **keys)
    (out / "pendulum.xml").write_text(MODEL)
    (out / "fitted.toml").write_text(HEAD + FITTED + runs)
    (out / "published.toml").write_text(HEAD + PUBLISHED + runs)


main()
