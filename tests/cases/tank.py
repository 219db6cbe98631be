"""MuJoCo moves a mechanism with what is hidden in it, and a camera looks at it.

Parameters of what is hidden bear the project's names (`buoyancy/link2`); what the project has no cause for is `outside/...`.
"""

import mujoco
import numpy as np

from mechanism import GRAVITY_M_S2, WATER_KG_M3
from servo import horn

# Added to the driven hinge where the horn's angle is imposed: loads of 1e-3 N m then shift it by less than 1e-9 rad in a step.
ROTOR_KG_M2 = 1.0
# What hangs is let settle under so much more damping, over the moment of a link's weight [s], for so long.
SETTLING_S, SETTLING_STEP_S, SETTLING_DAMPING_S = 6.0, 1e-3, 0.3
FRICTION_RATE_RAD_S = 0.03  # over which friction turns round; the simulation's own law is another one
LOOKS_EVERY = 200  # steps, for MuJoCo's warnings; its last ones lie beyond the last image
STROUHAL = 0.2  # of bluff bodies
# What takes a force in each step, and of that and MuJoCo's own elements what pulls at a mechanism at rest
PUSHES = ("cob_offset", "linear_drag", "slosh", "tether", "added_mass", "outside")
PULLS = ("current", "cob_offset", "tether", "joint_zero", "outside/slack")


# It would write a line a step, and a file where it was started
mujoco.set_mju_user_warning(lambda _: None)


class Diverged(Exception):
    """MuJoCo's steps have not followed the motion."""


class Tank:
    """One run's mechanism; `hidden` holds the parameters that are at work in this run."""

    def __init__(self, mechanism, hidden, step_s):
        self.mechanism, self.hidden, self.step_s = mechanism, hidden, step_s
        self.links = mechanism.links
        longer = {k: self.get(f"link_length/link{k}") for k in range(1, self.links + 1)}
        self.model = mujoco.MjModel.from_xml_string(mechanism.mjcf(True, longer))
        self.data = mujoco.MjData(self.model)
        self.sites = [self.model.site(f"P{k}").id for k in range(1, self.links + 1)]
        self.time_s, self.is_settling, self.rotor_n_m = 0.0, False, 0.0
        self.owned = None
        self._model_faults()
        self._start_memory(np.random.default_rng(int(self.get("outside/seed"))))

    def get(self, name):
        return self.hidden.get(name, 0.0)

    def each(self, cause, common, element, first=1):
        """Sizes per link, joint or shape: what is common to all from `first` on, and what each has of its own."""
        own = np.array([self.get(f"{cause}/{element}{k}") for k in range(1, self.links + 1)])
        return own + self.get(f"{cause}/{common}") * (np.arange(1, self.links + 1) >= first)

    def _model_faults(self):
        model = self.model
        model.opt.timestep, model.opt.integrator = self.step_s, mujoco.mjtIntegrator.mjINT_RK4
        model.opt.wind[:] = [self.get("current/x"), 0.0, self.get("current/z")]
        heavier = 1.0 + self.each("link_mass", "scale", "link")
        model.body_gravcomp[1:] *= (1.0 + self.each("buoyancy", "scale", "link")) / heavier
        model.body_mass[1:] *= heavier
        model.body_inertia[1:] *= heavier[:, None]
        model.dof_damping[:] += self.each("joint_damping", "damping", "q")
        model.jnt_stiffness[:] += self.each("stiffness", "stiffness", "q", first=2)
        friction = self.each("coulomb_friction", "torque", "q")
        soft = bool(self.get("coulomb_friction/soft"))
        self.friction = friction if friction.any() and not soft else None
        if soft:
            model.dof_frictionloss[:] += friction
        if self.mechanism.led:
            model.actuator_gainprm[:] = 0.0
            model.actuator_biasprm[:] = 0.0
        mujoco.mj_setConst(model, mujoco.MjData(model))

    def _start_memory(self, random):
        self.phase = random.uniform(0.0, 2 * np.pi, self.links)
        self.slow_velocity = np.zeros((self.links, 3))
        self.waves = random.uniform(0.25, 0.7, (3, self.links)), random.uniform(0.0, 2 * np.pi, (3, self.links))

    def velocities(self):
        """Velocities of the shapes' centres in the world [m/s]; each body's only shape is where its mass is."""
        found, six = np.zeros((self.links, 3)), np.zeros(6)
        for body in range(1, self.links + 1):
            mujoco.mj_objectVelocity(self.model, self.data, mujoco.mjtObj.mjOBJ_BODY, body, six, 0)
            found[body - 1] = six[3:]
        return found

    def push(self):
        """Forces that MuJoCo has no element for, as they are at the start of a step."""
        model, data, h = self.model, self.data, self.hidden
        data.qfrc_applied[:] = 0.0
        data.xfrc_applied[:] = 0.0
        data.qfrc_applied[0] = self.rotor_n_m
        if not self.causes_push:
            return
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        rate, force = data.qvel, data.xfrc_applied[1:]
        if self.friction is not None:
            data.qfrc_applied -= self.friction * np.tanh(rate / FRICTION_RATE_RAD_S)
        if "cob_offset/along" in h or "cob_offset/across" in h:
            lifted = WATER_KG_M3 * self.volumes() * GRAVITY_M_S2
            for body in range(1, model.nbody):
                turn = data.xmat[body].reshape(3, 3)
                along = self.mechanism.away * turn[:, 2]
                # across is counter-clockwise of along, as seen: (x, z) -> (-z, x)
                offset_x = self.get("cob_offset/along") * along[0] - self.get("cob_offset/across") * along[2]
                force[body - 1, 4] -= offset_x * lifted[body - 1]
        moving = self.velocities() if self.needs_velocities else None
        if "linear_drag/drag" in h:
            force[:, :3] -= h["linear_drag/drag"] * (moving - model.opt.wind)
        if "slosh/sin" in h and not self.is_settling:
            at = 2 * np.pi * h["slosh/frequency"] * self.time_s
            model.opt.wind[0] = self.get("current/x") + h["slosh/sin"] * np.sin(at) + h["slosh/cos"] * np.cos(at)
        if "tether/stiffness" in h:
            self.pull(np.array([h["tether/x"], 0.0, h["tether/z"]]), h["tether/stiffness"], 0.0)
        if "outside/slack" in h:
            self.pull(np.array([h["outside/slack_x"], 0.0, h["outside/slack_z"]]), h["outside/slack"], h["outside/slack_length"])
        if "outside/damper" in h:
            data.qfrc_applied[1:] -= h["outside/damper"] * rate[1:] * np.abs(rate[1:])
        if "outside/detent" in h:
            data.qfrc_applied[1:] -= h["outside/detent"] * np.sin(h["outside/notches"] * data.qpos[1:])
        if not self.is_settling:
            self._push_with_time(moving, force)
        if "added_mass/scale" in h:
            self._carry_water(h["added_mass/scale"])

    def _push_with_time(self, moving, force):
        h, width = self.hidden, self.mechanism.width_m
        area = width * self.mechanism.length_m
        if "outside/vortex" in h:
            speed = np.linalg.norm(moving, axis=1)
            self.phase += self.step_s * 2 * np.pi * STROUHAL * speed / width
            aside = np.stack([-moving[:, 2], 0 * speed, moving[:, 0]], 1)
            force[:, :3] += (0.5 * h["outside/vortex"] * WATER_KG_M3 * area * speed * np.sin(self.phase))[:, None] * aside
        if "outside/wake" in h:
            # the water is dragged along: drag is on what is left of the velocity
            keep = np.exp(-self.step_s / h["outside/wake_s"])
            self.slow_velocity = keep * self.slow_velocity + (1 - keep) * moving
            left = moving - h["outside/wake"] * self.slow_velocity
            quadratic = lambda v: np.linalg.norm(v, axis=1, keepdims=True) * v
            force[:, :3] += 0.5 * WATER_KG_M3 * area * (quadratic(moving) - quadratic(left))
        if "outside/drift" in h:
            rates, phases = self.waves
            waves = np.sin(2 * np.pi * rates * self.time_s + phases).mean(0)
            self.data.qfrc_applied[1:] += h["outside/drift"] * waves[1:]

    def volumes(self):
        """Displaced volumes by what the model's owner states: mass times gravcomp over the water's density."""
        if self.owned is None:
            self.owned = mujoco.MjModel.from_xml_string(self.mechanism.mjcf())
        return self.owned.body_mass[1:] * self.owned.body_gravcomp[1:] / WATER_KG_M3

    def pull(self, anchor, stiffness, free_m):
        """A cable from `anchor` to the last keypoint, slack up to a length of `free_m`."""
        tip = self.data.site_xpos[self.sites[-1]]
        away = anchor - tip
        far = np.linalg.norm(away)
        if far > free_m:
            pulled = stiffness * (far - free_m) / far * away
            mujoco.mj_applyFT(self.model, self.data, pulled, np.zeros(3), tip, self.links, self.data.qfrc_applied)

    def _carry_water(self, scale):
        """Added mass's part with acceleration: solves (M + J' mA J) a = f and applies what that takes."""
        model, data = self.model, self.data
        mujoco.mj_forward(model, data)
        n = model.nv
        mass, carried, bias = np.zeros((n, n)), np.zeros((n, n)), np.zeros(n)
        mujoco.mj_fullM(model, data, mass)
        jacobians = [np.zeros((3, n)) for _ in range(4)]
        for geom in range(model.ngeom):
            at, turn, body = data.geom_xpos[geom], data.geom_xmat[geom].reshape(3, 3), int(model.geom_bodyid[geom])
            mujoco.mj_jac(model, data, jacobians[0], jacobians[1], at, body)
            mujoco.mj_jacDot(model, data, jacobians[2], jacobians[3], at, body)
            go, spin, go_dot, spin_dot = (turn.T @ j for j in jacobians)
            fluid = WATER_KG_M3 * scale * model.geom_fluid[geom, 6:12]
            through = go @ data.qvel - turn.T @ model.opt.wind
            quick = go_dot @ data.qvel - np.cross(spin @ data.qvel, through)
            carried += go.T @ (fluid[:3, None] * go) + spin.T @ (fluid[3:, None] * spin)
            bias += go.T @ (fluid[:3] * quick) + spin.T @ (fluid[3:] * (spin_dot @ data.qvel))
        faster = np.linalg.solve(mass + carried, mass @ data.qacc - bias)
        data.qfrc_applied -= carried @ faster + bias

    def _settle(self, turned):
        """Lets the mechanism come to rest under the servo's first angle."""
        model, data = self.model, self.data
        before = model.dof_damping.copy(), model.opt.timestep
        model.dof_damping[:] += SETTLING_DAMPING_S * self.mechanism.torque_n_m() * self.links
        model.opt.integrator, model.opt.timestep = mujoco.mjtIntegrator.mjINT_IMPLICITFAST, SETTLING_STEP_S
        self.is_settling = True
        for _ in range(int(SETTLING_S / SETTLING_STEP_S)):
            self._drive(turned, 0.0, 0.0, turned)
            self.push()
            mujoco.mj_step(model, data)
        self.is_settling = False
        model.dof_damping[:], model.opt.timestep = before
        model.opt.integrator = mujoco.mjtIntegrator.mjINT_RK4
        data.qvel[:] = 0.0

    def _drive(self, angle, rate, speeding, middle):
        if self.mechanism.led:
            self.data.qpos[0], self.data.qvel[0] = angle, rate
            self.rotor_n_m = ROTOR_KG_M2 * speeding
        else:
            self.data.ctrl[0] = middle

    def move(self, start_s, end_s, held=None, stroke=None):
        """Times and keypoints, shape (steps, links, 2): from `held` let go at `start_s`, or driven by `stroke`."""
        model, data = self.model, self.data
        steps = int(np.ceil((end_s - start_s) / self.step_s)) + 1
        times = start_s + self.step_s * np.arange(steps)
        self.causes_push = self.friction is not None or any(name.startswith(PUSHES) for name in self.hidden)
        self.needs_velocities = any(name.startswith(("linear_drag", "outside/vortex", "outside/wake")) for name in self.hidden)
        imposed = stroke is not None or not self.mechanism.led
        if stroke is not None:
            fine = start_s + 0.5 * self.step_s * np.arange(2 * steps + 1)
            turned = horn(stroke, fine, self.hidden)
        else:
            turned = np.full(2 * steps + 1, self.get("joint_zero/q1"))
        rate = np.gradient(turned, 0.5 * self.step_s)
        speeding = np.gradient(rate, 0.5 * self.step_s)
        model.dof_armature[0] = ROTOR_KG_M2 if imposed and self.mechanism.led else 0.0
        data.qpos[:] = 0.0 if held is None else held
        if imposed:
            data.qpos[0] = turned[0]
        if stroke is not None and any(name.startswith(PULLS) for name in self.hidden):
            self._settle(turned[0])
        self.first_pose = data.qpos.copy()
        points = np.empty((steps, self.links, 2))
        for k in range(steps):
            self.time_s = times[k]
            if imposed:
                self._drive(turned[2 * k], rate[2 * k], speeding[2 * k + 1], turned[2 * k + 1])
            self.push()
            mujoco.mj_kinematics(model, data)
            points[k] = data.site_xpos[self.sites][:, [0, 2]]
            for point in range(self.links):
                slip = self.get(f"keypoint_slip/P{point + 1}")
                if slip:
                    link = points[k, point] - data.xanchor[point, [0, 2]]
                    points[k, point] += slip * link / np.linalg.norm(link)
            mujoco.mj_step(model, data)
            if k % LOOKS_EVERY == 0 and any(warning.number for warning in data.warning):
                raise Diverged
        return times, points

    def look(self, times, points, image_times):
        """What images taken at these stated times show, shape (images, links, 2)."""
        seen = np.empty((len(image_times), self.links, 2))
        for k in range(self.links):
            when = image_times + self.get("camera_delay/delay")
            if "rolling_shutter/slowness" in self.hidden:
                when = when + self.get("rolling_shutter/slowness") * np.interp(when, times, points[:, k, 1])
            for axis in (0, 1):
                seen[:, k, axis] = np.interp(when, times, points[:, k, axis])
        seen *= 1.0 + self.get("lens/radial") * (seen**2).sum(-1, keepdims=True)
        tilt = self.get("camera_tilt/x") * seen[..., :1] + self.get("camera_tilt/z") * seen[..., 1:]
        seen *= (1.0 + tilt) * (1.0 + self.get("camera_scale/scale"))
        c, s = np.cos(self.get("camera_rotation/angle")), np.sin(self.get("camera_rotation/angle"))
        return seen @ np.array([[c, -s], [s, c]]).T + [self.get("camera_offset/x"), self.get("camera_offset/z")]
