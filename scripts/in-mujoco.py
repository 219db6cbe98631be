"""What a fit of `rig` found, in MuJoCo itself: python in-mujoco.py RUN (pip install mujoco numpy).

RUN is a run folder, or one with fit.json and model.xml of `rig fit` beside trajectory.csv and servo.csv. Prints each keypoint's root
mean square error in metres: `rms_error_m` of fit.json."""
import json, sys
import mujoco, numpy

run = sys.argv[1]
fit = json.load(open(f"{run}/fit.json"))["runs"][0]
seen = numpy.genfromtxt(f"{run}/trajectory.csv", delimiter=",", names=True)
servo = numpy.genfromtxt(f"{run}/servo.csv", delimiter=",", names=True)

model = mujoco.MjModel.from_xml_path(f"{run}/model.xml")
model.opt.timestep = 5e-5  # so fine that the integrator does not show in the digits printed
data = mujoco.MjData(model)
mujoco.mj_resetDataKeyframe(model, data, model.key(fit["id"]).id)
told = numpy.array([servo[f"{model.actuator(i).name}_rad"] for i in range(model.nu)])
moves = numpy.argmax(numpy.any(numpy.diff(told), axis=0))
data.time = servo["time_s"][moves]  # at rest until the servo first moves
seen = seen[seen["time_s"] >= data.time]
times, places = [], []
while data.time < seen["time_s"][-1] + model.opt.timestep:
    data.ctrl = [numpy.interp(data.time, servo["time_s"], angles) for angles in told]
    mujoco.mj_kinematics(model, data)
    times.append(data.time)
    places.append(data.site_xpos.copy())
    mujoco.mj_step(model, data)

for name in (keypoint["name"] for keypoint in fit["keypoints"]):
    path = numpy.array(places)[:, model.site(name).id]
    off = [seen[f"{name}_{axis}_m"] - numpy.interp(seen["time_s"], times, path[:, i])
           for i, axis in enumerate("xyz") if f"{name}_{axis}_m" in seen.dtype.names]
    print(name, "%.3g" % numpy.sqrt(numpy.nanmean(sum(o * o for o in off))))
