//! `basset`: the water remembers how a shape has moved.

use crate::causes::hooks::{Moment, Step};
use crate::causes::water::shapes::{drift, force_at};
use crate::dynamics::Work;
use crate::dynamics::plant::Plant;
use crate::math::Vector;
use crate::model::Model;
use crate::model::cause::{CauseInfo, CauseValues, Kind, ParameterInfo};
use crate::scalar::Scalar;
use crate::space::Space;

pub(crate) const INFO: CauseInfo = CauseInfo {
    name: "basset",
    kind: Kind::Physics,
    parameters: &[ParameterInfo::size(
        "history",
        "N s^1.5/m",
        [0.0, 1.0],
        2e-4,
        "history force of each wet shape per root of time",
    )],
    aliases: &[],
    sentence: "the boundary layer's memory drags on after every change of speed",
    check: "repeat a stroke after a long rest and straight after another",
    formula: "F = -c int a(s) / sqrt(t - s) ds at the centre of each ellipsoid, a the rate of its velocity against the water",
    source: "Basset 1888; a sphere of radius r has c = 6 r^2 sqrt(pi rho mu). World axes; what came before the run is forgotten",
    mjcf: None,
    in_picture_plane: false,
};

/// The kernel is a sum of exponentials: their number, the slowest one's rate \[1/s\], the natural logarithm of the ratio of successive rates,
const KERNEL_EXPONENTIAL_COUNT: usize = 9;
const SLOWEST_RATE_PER_S: f64 = 0.033_245_979_3;
const LOG_RATE_RATIO: f64 = 1.463_367_468_6;
/// and their weights, by least squares on 1/sqrt(t) from 2 ms to 10 s and on its integral from 1 ms on: the last, fastest one
/// stands for all that is quicker.
const KERNEL_WEIGHTS: [f64; KERNEL_EXPONENTIAL_COUNT] = [
    0.365_551_50,
    0.218_330_06,
    0.676_864_07,
    1.338_927_57,
    2.823_276_53,
    5.814_722_49,
    12.223_353_13,
    24.688_764_01,
    102.781_724_76,
];

/// 1/sqrt(t) as a sum of exponentials w exp(-l t), each (w, l). Good to 0.4 % from 2 ms to 10 s, its integral from 0 to 0.2 %
/// from 1 ms on.
fn kernel() -> [(f64, f64); KERNEL_EXPONENTIAL_COUNT] {
    std::array::from_fn(|k| (KERNEL_WEIGHTS[k], SLOWEST_RATE_PER_S * (LOG_RATE_RATIO * k as f64).exp()))
}

/// How much of a memory is left after `time_s`, and how much a velocity that changed evenly meanwhile adds to it.
fn fade(rate: f64, time_s: f64) -> (f64, f64) {
    let x = rate * time_s;
    if x == 0.0 {
        return (1.0, 1.0);
    }
    ((-x).exp(), -(-x).exp_m1() / x)
}

/// The history force.
#[derive(Debug, Clone)]
pub(crate) struct Term<S: Space> {
    history: S::T,
    geoms: usize,
    kernel: [(f64, f64); KERNEL_EXPONENTIAL_COUNT],
}

impl<S: Space> Step<S> for Term<S> {
    fn new(values: &CauseValues<S::T>, _: &Model<S::T>, plant: &Plant<S>) -> Self {
        Self { history: values.one(0), geoms: plant.fluid_geoms.len(), kernel: kernel() }
    }

    /// Per shape: its velocity at the last step's end, and the memories then.
    fn memory(&self) -> usize {
        self.geoms * (1 + KERNEL_EXPONENTIAL_COUNT)
    }

    /// Velocities count as even between the instants that the forces are asked for at, so memories of less than a step
    /// stay stable and exact.
    #[inline(always)]
    fn wrenches(&self, moment: Moment, plant: &Plant<S>, work: &mut Work<S>, memory: &mut [S::Vec]) {
        let fades = self.kernel.map(|(_, rate)| fade(rate, moment.elapsed_s));
        let decays = moment.arrived_s.map(|step_s| self.kernel.map(|(_, rate)| fade(rate, step_s)));
        for (geom, memory) in
            plant.fluid_geoms.iter().zip(memory.chunks_exact_mut(1 + KERNEL_EXPONENTIAL_COUNT))
        {
            let (v, at) = drift(geom, plant, work);
            let (last, memories) = match memory {
                [last, memories @ ..] => (last, memories),
                [] => continue,
            };
            if let Some(decays) = &decays {
                let change = v - *last;
                for (memory, &(keep, take)) in memories.iter_mut().zip(decays) {
                    *memory = *memory * S::T::from_f64(keep) + change * S::T::from_f64(take);
                }
                *last = v;
            }
            let change = v - *last;
            let mut sum = S::Vec::ZERO;
            for ((memory, (keep, take)), (weight, _)) in memories.iter().zip(fades).zip(self.kernel) {
                let now = *memory * S::T::from_f64(keep) + change * S::T::from_f64(take);
                sum += now * S::T::from_f64(weight);
            }
            work.wrench[geom.body] += force_at(sum * -self.history, at);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exponentials_make_up_the_root_of_time() {
        for k in 0..=100 {
            let time_s = 2e-3 * (5000.0_f64).powf(f64::from(k) / 100.0);
            let sum: f64 = kernel().iter().map(|(weight, rate)| weight * (-rate * time_s).exp()).sum();
            assert!((sum * time_s.sqrt() - 1.0).abs() < 0.004, "{time_s} {}", sum * time_s.sqrt());
            // what a step of the acceleration leaves
            let time_s = 0.5 * time_s;
            let whole: f64 =
                kernel().iter().map(|(weight, rate)| -weight * (-rate * time_s).exp_m1() / rate).sum();
            assert!((whole / (2.0 * time_s.sqrt()) - 1.0).abs() < 0.002, "{time_s}");
        }
    }
}
