"""What is wrong with the files rather than the tank: wrong descriptions, spoilt runs, trackers' errors."""

import numpy as np

DESCRIPTIONS = (
    "release release_one labels_run labels_images clock_rate axes z_down mirrored millimetres pixels frame_numbers milliseconds "
    "degrees zeros_lost other_mechanism camera_knocked images_lost servo_reversed order_reversed y_not_z"
).split()
TRACKERS = ["outliers", "gaps", "quantised", "pose_bias", "slow_noise"]
PX_PER_M, ORIGIN_PX = 4000.0, (320.0, 60.0)  # a camera of 0.25 mm a pixel
LOST_IMAGES = 6
LOST_EVERY = 8  # one row in eight has no second keypoint


class Run:
    """One run's files: times (n,) [s], keypoints (n, K, 2) [m] with NaN where a mark is lost, the servo's rows (m, 2) or none."""

    def __init__(self, name, kind, use, start_s):
        self.name, self.kind, self.use, self.start_s = name, kind, use, start_s
        self.stated_release_s = None
        self.times = self.seen = self.servo = None
        self.axes = ("x", "z")


def describe_wrongly(kind, runs, random):
    """Spoils the files; says how."""
    off_s = lambda: float(random.choice([-1.0, 1.0])) * random.uniform(0.02, 0.06)
    drops = [run for run in runs if run.kind == "drop"]
    hidden = {"kind": kind, "runs": [run.name for run in runs]}
    if kind in ("release", "release_one", "release_each"):
        late = drops[:1] if kind == "release_one" else drops
        sizes = [off_s()] * 2 if kind == "release" else [off_s() for _ in drops]
        for run, size in zip(late, sizes):
            run.stated_release_s = round(run.start_s + size, 3)
        # what is stated less what is so
        return {**hidden, "runs": [run.name for run in late], "release_s": dict(zip([run.name for run in late], sizes))}
    if kind in ("labels_run", "labels_images", "camera_knocked", "images_lost"):
        run = runs[int(random.integers(len(runs)))]
        count = len(run.times)
        hidden["runs"] = [run.name]
        if kind == "labels_run":
            run.seen[:, [0, 1]] = run.seen[:, [1, 0]]
        elif kind == "labels_images":
            many = int(random.integers(8, 30))
            first = int(random.integers(count // 4, count - many))
            run.seen[first : first + many, [0, 1]] = run.seen[first : first + many, [1, 0]]
            hidden.update(images=[first, first + many])
        elif kind == "camera_knocked":
            first, angle = int(random.integers(count // 3, 2 * count // 3)), random.choice([-1, 1]) * random.uniform(0.005, 0.015)
            turn = np.array([[1.0, -angle], [angle, 1.0]])
            shift = random.uniform(1e-3, 3e-3) * np.array([random.choice([-1, 1]), random.choice([-1, 1])])
            run.seen[first:] = run.seen[first:] @ turn.T + shift
            hidden.update(images=[first, count], shift_m=shift.tolist(), angle_rad=float(angle))
        else:
            first = int(random.integers(count // 4, count // 2))
            run.seen = np.delete(run.seen, np.s_[first : first + LOST_IMAGES], axis=0)
            run.times = run.times[:-LOST_IMAGES]
            hidden.update(images=[first, first + LOST_IMAGES])
        return hidden
    if kind == "clock_rate":
        hidden["rate"] = random.choice([-1, 1]) * random.uniform(0.006, 0.02)
    for run in runs:
        if kind == "clock_rate":
            run.times = run.times * (1.0 + hidden["rate"])
        elif kind == "axes":
            run.axes = ("z", "x")
        elif kind == "y_not_z":
            run.axes = ("x", "y")
        elif kind == "z_down":
            run.seen = run.seen * [1.0, -1.0]
        elif kind == "mirrored":
            run.seen = run.seen * [-1.0, 1.0]
        elif kind == "millimetres":
            run.seen = run.seen * 1e3
        elif kind == "pixels":
            run.seen = run.seen * [PX_PER_M, -PX_PER_M] + ORIGIN_PX
        elif kind == "frame_numbers":
            run.times = np.arange(len(run.times), dtype=float)
        elif kind == "milliseconds":
            run.times = run.times * 1e3
        elif kind == "zeros_lost":
            run.seen[int(random.integers(LOST_EVERY)) :: LOST_EVERY, 1] = 0.0
        elif kind == "order_reversed":
            run.seen = run.seen[:, ::-1]
        elif run.servo is not None and kind in ("degrees", "servo_reversed"):
            run.servo = run.servo * [1.0, np.degrees(1.0) if kind == "degrees" else -1.0]
    return hidden


def track_badly(kind, runs, mechanism, random):
    """A tracker's errors, beside those of the noise; says how."""
    hidden = {"kind": kind}
    if kind == "outliers":
        hidden["share"] = random.uniform(0.003, 0.01)
    if kind == "gaps":
        hidden["share"] = random.uniform(0.04, 0.12)
    if kind == "pose_bias":
        hidden.update(size_m=random.uniform(2e-4, 5e-4), phase_rad=random.uniform(0, 2 * np.pi, mechanism.links).tolist())
    for run in runs:
        if kind == "outliers":
            # single images: a reflection, back at once
            struck = random.random(run.seen.shape[:2]) < hidden["share"]
            struck[1:] &= ~struck[:-1]
            turn = random.uniform(0, 2 * np.pi, struck.shape)
            far = random.uniform(0.008, 0.025, struck.shape)
            run.seen += (struck * far)[..., None] * np.stack([np.cos(turn), np.sin(turn)], -1)
        elif kind == "gaps":
            run.seen[random.random(run.seen.shape[:2]) < hidden["share"] / 2] = np.nan
            length = max(2, int(len(run.times) * hidden["share"] / 2))
            first, point = int(random.integers(len(run.times) - length)), int(random.integers(mechanism.links))
            run.seen[first : first + length, point] = np.nan
        elif kind == "pose_bias":
            # what a tracker clings to moves along the link as the link turns
            clean = run.clean
            for point in range(mechanism.links):
                parent = mechanism.parent(point + 1)
                along = clean[:, point] - (clean[:, parent - 1] if parent else 0.0)
                along /= np.linalg.norm(along, axis=1, keepdims=True)
                angle = np.unwrap(np.arctan2(along[:, 1], along[:, 0]))
                run.seen[:, point] += hidden["size_m"] * np.sin(2 * angle + hidden["phase_rad"][point])[:, None] * along
    return hidden
