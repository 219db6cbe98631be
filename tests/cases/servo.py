"""A servo and its profile: the commanded angle over time, and what the horn does with it."""

import numpy as np


class Stroke:
    """Strokes to and fro; the counter-clockwise one lasts twice as long. The first half period starts softly."""

    def __init__(self, amplitude_rad, period_s, start_s):
        self.amplitude_rad, self.period_s, self.start_s = amplitude_rad, period_s, start_s

    def command(self, times_s):
        """Commanded angle at `times_s` [rad]; 0 before the start."""
        t = np.maximum(np.asarray(times_s, float) - self.start_s, 0.0)
        share = np.mod(t / self.period_s, 1.0)
        turn = np.where(share < 2 / 3, share * 0.75, 0.5 + (share - 2 / 3) * 1.5)
        # grows from 0 within half a period with a rate that starts and ends at 0
        grown = np.clip(t / (0.5 * self.period_s), 0.0, 1.0)
        return self.amplitude_rad * (3 * grown**2 - 2 * grown**3) * (-np.cos(2 * np.pi * turn) + 1.0 - grown)


def horn(stroke, times_s, hidden):
    """Angle of the horn at evenly spaced `times_s` [rad]; `hidden` holds parameters by the project's names."""
    get = lambda name: hidden.get(name, 0.0)
    step = times_s[1] - times_s[0]
    asked = stroke.command(times_s - get("servo_delay/delay"))
    told = (1.0 + get("servo_gain/scale")) * (1.0 - get("servo_sag/rate") * times_s) * asked
    rate, lag, play = hidden.get("servo_rate_limit/rate", np.inf), get("servo_lag/time"), get("backlash/half_width")
    turned = told.copy()
    if np.isfinite(rate):
        for k in range(1, len(told)):
            turned[k] = turned[k - 1] + np.clip(told[k] - turned[k - 1], -rate * step, rate * step)
    if lag > 0.0:
        followed, keep = turned.copy(), np.exp(-step / lag)
        for k in range(1, len(told)):
            followed[k] = keep * followed[k - 1] + (1.0 - keep) * 0.5 * (turned[k] + turned[k - 1])
        turned = followed
    if play > 0.0:
        for k in range(1, len(told)):
            turned[k] = min(max(turned[k - 1], turned[k] - play), turned[k] + play)
    return turned + get("joint_zero/q1")
