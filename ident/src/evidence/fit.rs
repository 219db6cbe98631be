//! A set of causes at its optimum: Gauss-Newton steps from where another set has been, the unknown's scales found anew at each.

use std::collections::BTreeMap;
use std::sync::Arc;

use nalgebra::DVector;

use super::bounded::bounded;
use super::columns::{Belief, Column};
use super::gram::{self, Gram};
use super::linear::{Bench, Point, RunColumns, Setting};
use super::priors::{Beliefs, OFF, Scales};
use super::score::{Scored, Scorer, TAU_START};
use crate::fit::counts::Counts;
use crate::parameters::ON_BOUND_SHARE;

/// Most steps of one fit (a prototype, chosen).
pub(super) const MOST_STEPS: usize = 8;
/// A step that would gain less is not worth it, in nats: a twentieth of what could matter to anyone.
const NOT_WORTH_A_STEP: f64 = 0.05;
/// How far a coefficient may be from its nominal value, one standard deviation, over that value (chosen; a prototype took 0.5 to 0.7 of its
/// logarithm).
const COEFFICIENT_WIDTH: f64 = 2.0;
/// A scale with a finer resolution over its width goes over decades.
const KNOWN_RESOLUTION_SHARE: f64 = 0.01;
/// Ways that a step may go, each a damping over the diagonal of the products and a share of what that leads to: the first that leads downhill is
/// taken, from the one before where the last step found its own (chosen). Shares of the way itself are what a stiff arm of many segments wants;
/// where a joint sticks, only short ways in other directions are as all that is linear says.
const WAYS: [[f64; 2]; 7] =
    [[0.0, 1.0], [0.0, 0.4], [0.0, 0.1], [0.03, 1.0], [0.3, 1.0], [3.0, 1.0], [30.0, 1.0]];
/// Most of them that one step tries.
const MOST_TRIES: usize = 6;

/// What is linear about a point is believed of so large a share of what the point costs (chosen): fits of an arm of many segments stop a few
/// hundredths short of where they should end, whatever the cause.
const UNREACHED_SHARE: f64 = 0.05;

/// A set of causes at a point, with the products about it.
pub(super) struct Fitted {
    pub(super) setting: Setting,
    pub(super) point: Point,
    pub(super) gram: Gram,
    pub(super) scored: Scored,
    /// By how much the evidence is less than what is linear about `point` promises without bounds \[nats\]: to be taken off whatever else is
    /// scored with `gram`.
    pub(super) shortfall: f64,
    /// Whether `gram` holds the columns of all candidates.
    pub(super) is_expanded: bool,
    /// Whether the unknown was let in.
    pub(super) is_free: bool,
}

impl Fitted {
    /// The sizes that `columns` have in it; 0 for those that it has not.
    pub(super) fn sizes_in(&self, columns: &[Column]) -> Vec<f64> {
        let known = |column: &Column| {
            let own = self.setting.columns.iter().position(|other| other == column);
            own.map_or(0.0, |place| self.point.sizes[place])
        };
        columns.iter().map(known).collect()
    }
}

/// Where runs stand, linearised.
struct Standing {
    point: Point,
    columns: Vec<RunColumns>,
    gram: Gram,
}

/// How far a fit goes.
#[derive(Debug, Clone, Copy)]
pub(super) struct Effort {
    /// With the unknown wherever its evidence wants it.
    pub(super) unknown: bool,
    /// Most steps.
    pub(super) steps: usize,
    /// What has less evidence than this once the unknown is let in stays where it is.
    pub(super) least: f64,
}

/// Fits sets of causes.
pub(super) struct Fitter<'b, 'a> {
    pub(super) bench: &'b Bench<'a>,
    pub(super) noise_share: f64,
    /// Centres of what is believed of what is fitted anyway, and precisions.
    centres: Vec<f64>,
    beliefs: Beliefs,
}

impl<'b, 'a> Fitter<'b, 'a> {
    pub(super) fn new(bench: &'b Bench<'a>, noise_share: f64) -> Self {
        let free = &bench.state.parameters.free;
        let beliefs = Beliefs {
            base: free
                .iter()
                .map(|free| {
                    let width = free.scale.width().max(f64::MIN_POSITIVE);
                    // what is spread evenly over its bounds is a coefficient whose size is about known
                    let is_known = free.scale.resolution() > KNOWN_RESOLUTION_SHARE * width;
                    let about = COEFFICIENT_WIDTH * free.start.abs().max(free.scale.resolution());
                    let usual = if is_known { about.min(width) } else { width };
                    free.prior.map_or(usual, |prior| prior.std.get().min(width)).powi(-2)
                })
                .collect(),
            starts: bench
                .state
                .terms
                .iter()
                .map(|term| term.rehearsal.nuisances.iter().map(|own| own.belief().powi(-2)).collect())
                .collect(),
            stated_slip: bench.unknown.stated_slip,
            own: (0..bench.runs())
                .map(|run| {
                    let covariance = bench.unknown.covariance(run);
                    let factor = covariance.cholesky();
                    factor.map_or_else(
                        || (nalgebra::DMatrix::zeros(0, 0), 0.0),
                        |factor| {
                            let diagonal = factor.l_dirty().diagonal();
                            (factor.inverse(), 2.0 * diagonal.iter().map(|x: &f64| x.ln()).sum::<f64>())
                        },
                    )
                })
                .collect(),
        };
        let centres =
            free.iter().map(|free| free.prior.map_or(free.start, |prior| prior.mean.get())).collect();
        Self { bench, noise_share, centres, beliefs }
    }

    pub(super) fn scorer<'s>(&'s self, gram: &'s Gram) -> Scorer<'s> {
        Scorer { atoms: &self.bench.atoms, gram, noise_share: self.noise_share }
    }

    /// Squares that `fitted` leaves without the unknown, over those of the noise.
    pub(super) fn misfit(&self, fitted: &Fitted) -> f64 {
        fitted.gram.reduced(OFF).map_or(0.0, |reduced| reduced.cost / fitted.gram.observations as f64)
    }

    /// The numbers that are fitted anyway and that a bound holds, once all that is linear about `standing` is where `scored` says.
    fn held(&self, setting: &Setting, standing: &Standing, scored: &Scored) -> Vec<usize> {
        let Some(target) = self.target(setting, &standing.point, &standing.gram, scored) else {
            return Vec::new();
        };
        let is_held = |place: &usize| {
            let scale = &self.bench.state.parameters.free[*place].scale;
            let near = ON_BOUND_SHARE * scale.width();
            let value = target.base[*place];
            value - scale.lower() <= near || scale.upper() - value <= near
        };
        (0..target.base.len()).filter(is_held).collect()
    }

    /// Products about `point`, what is fitted anyway at `held` staying as it is.
    fn gram(&self, setting: &Setting, point: &Point, columns: &[RunColumns], held: &[usize]) -> Gram {
        let mut beliefs = self.beliefs.clone();
        held.iter().for_each(|&place| beliefs.base[place] = f64::INFINITY);
        let beliefs = Arc::new(beliefs);
        let base: Vec<f64> = point
            .base
            .iter()
            .zip(&self.centres)
            .zip(&beliefs.base)
            .map(|((value, centre), precision)| if precision.is_finite() { value - centre } else { 0.0 })
            .collect();
        let sizes = |run: usize| {
            let mut sizes = BTreeMap::new();
            for (column, size) in setting.columns.iter().zip(&point.sizes) {
                if column.acts_in(run) && !matches!(column.belief, Belief::Hidden(_)) {
                    *sizes.entry(column.number).or_insert(0.0) += size;
                }
            }
            sizes
        };
        let each = point.offsets.iter().enumerate().map(|(run, own)| gram::Standing {
            base: base.clone(),
            start: own.clone(),
            numbers: sizes(run),
        });
        let is_hidden = |column: &Column| matches!(column.belief, Belief::Hidden(_));
        let hidden = setting.columns.iter().zip(&point.sizes).filter(|(column, _)| is_hidden(column));
        let hidden = hidden.map(|(column, size)| (column.number, *size)).collect();
        Gram::new(columns, &each.collect::<Vec<_>>(), hidden, beliefs)
    }

    fn stand(
        &self,
        setting: &Setting,
        point: Point,
        with_unknown: bool,
        counts: &mut Counts,
    ) -> Option<Standing> {
        let mut columns = self.bench.linear(setting, &point, counts)?;
        if with_unknown && !self.bench.add_unknown(setting, &point, &mut columns, counts) {
            return None;
        }
        let gram = self.gram(setting, &point, &columns, &[]);
        Some(Standing { point, columns, gram })
    }

    /// What `standing` costs at the scales of `scored`, beliefs included.
    fn cost(&self, setting: &Setting, standing: &Standing, scored: &Scored) -> Option<f64> {
        let Standing { point, gram, .. } = standing;
        let square = |x: f64, precision: f64| precision * x * x;
        let base = point.base.iter().zip(&self.centres).zip(&self.beliefs.base);
        let base: f64 = base.map(|((x, centre), precision)| square(x - centre, *precision)).sum();
        let starts = point.offsets.iter().flatten().zip(self.beliefs.starts.iter().flatten());
        let starts: f64 = starts.map(|(x, precision)| square(*x, *precision)).sum();
        let sizes = setting.columns.iter().zip(&point.sizes).map(|(column, &size)| match column.belief {
            Belief::Size(scale) => 2.0 * (size / scale).powi(2).ln_1p(),
            Belief::Deviation(typical) => (size / (super::score::tau(scored.tau) * typical)).powi(2),
            Belief::Hidden(std) => (size / std).powi(2),
            Belief::Given => 0.0,
        });
        Some((gram.reduced(scored.scales)?.cost + sizes.sum::<f64>()) / scored.variance + base + starts)
    }

    /// Where `scored`, about `point` with the products `gram`, says that the optimum of `setting` is, within all bounds.
    pub(super) fn target(
        &self,
        setting: &Setting,
        point: &Point,
        gram: &Gram,
        scored: &Scored,
    ) -> Option<Point> {
        self.damped(setting, point, gram, scored, 0.0)
    }

    /// The same on the way there, the nearer to `point` the larger `damping` is.
    fn damped(
        &self,
        setting: &Setting,
        point: &Point,
        gram: &Gram,
        scored: &Scored,
        damping: f64,
    ) -> Option<Point> {
        let reduced = gram.reduced(scored.scales)?;
        let free = &self.bench.state.parameters.free;
        let (mut asked, mut places): (Vec<(usize, &[usize])>, Vec<usize>) = (Vec::new(), Vec::new());
        let turned = |column: &&Column| column.belief != Belief::Given;
        for (place, column) in setting.columns.iter().enumerate().filter(|(_, column)| turned(column)) {
            if let Ok(number) = gram.numbers.binary_search(&column.number) {
                asked.push((number, &column.runs));
                places.push(place);
            }
        }
        let (mut products, mut data) = reduced.joint(&asked);
        let first = reduced.kept.len();
        let hidden = gram.hidden(&asked);
        data += products.columns(first, asked.len()) * &hidden;
        let mut bounds: Vec<[f64; 2]> = reduced
            .kept
            .iter()
            .map(|&place| match free.get(place) {
                Some(free) => free.scale.reach(point.base[place]).map(|bound| bound - self.centres[place]),
                None => [f64::NEG_INFINITY, f64::INFINITY],
            })
            .collect();
        for (own, &place) in places.iter().enumerate() {
            let column = &setting.columns[place];
            let known = &self.bench.atoms.numbers[column.number];
            let [lower, upper] = known.bounds.map(|bound| bound - known.neutral);
            bounds.push([if column.is_positive { 0.0 } else { lower.min(0.0) }, upper.max(0.0)]);
            let size = scored.sizes[place].unwrap_or(0.0);
            products[(first + own, first + own)] +=
                column.belief.precision(size, super::score::tau(scored.tau));
        }
        // the unknown stands nowhere: it is not damped
        let base = reduced.kept.iter().enumerate().filter(|(_, place)| **place < free.len());
        let base = base.map(|(own, &place)| (own, point.base[place] - self.centres[place]));
        let sizes = places
            .iter()
            .enumerate()
            .map(|(own, &place)| (first + own, point.sizes.get(place).copied().unwrap_or(0.0)));
        for (own, standing) in base.chain(sizes) {
            let damped = damping * products[(own, own)];
            products[(own, own)] += damped;
            data[own] += damped * standing;
        }
        let found = bounded(&products, &data, &bounds)?;
        let mut sizes = point.sizes.clone();
        sizes.resize(setting.columns.len(), 0.0);
        if point.sizes.len() != sizes.len() {
            sizes.fill(0.0);
        }
        for (own, &place) in places.iter().enumerate() {
            sizes[place] = found[first + own];
        }
        let by_run: Vec<DVector<f64>> = (0..self.bench.runs())
            .map(|run| {
                let mut all = DVector::zeros(gram.numbers.len());
                for (((number, runs), &place), hidden) in asked.iter().zip(&places).zip(hidden.iter()) {
                    if runs.contains(&run) {
                        all[*number] += sizes[place] - hidden;
                    }
                }
                all
            })
            .collect();
        let starts = gram.starts(scored.scales, &found.as_slice()[..first], &by_run)?;
        let mut base = point.base.clone();
        for (&place, size) in reduced.kept.iter().zip(found.iter()).filter(|(place, _)| **place < free.len())
        {
            base[place] = free[place].scale.clamp(self.centres[place] + size);
        }
        let offsets = self.bench.state.terms.iter().zip(&starts).map(|(term, starts)| {
            let nuisances = term.rehearsal.nuisances.iter().zip(starts);
            nuisances.map(|(nuisance, start)| nuisance.clamp(*start)).collect()
        });
        Some(Point { base, offsets: offsets.collect(), sizes })
    }

    /// The optimum of `setting` from `point` and `scales`. `None` where nothing near it can be simulated.
    pub(super) fn fit(
        &self,
        setting: Setting,
        point: Point,
        scales: (Scales, usize),
        effort: Effort,
        counts: &mut Counts,
    ) -> Option<(Fitted, Vec<RunColumns>)> {
        let free = effort.unknown;
        let mut from = if free { scales } else { (OFF, scales.1) };
        let mut standing = self.stand(&setting, point, free && from.0 != OFF, counts)?;
        let tuned = |standing: &Standing, from, free: bool| {
            self.scorer(&standing.gram).tuned(&setting.set, &setting.columns, from, free)
        };
        let mut scored = tuned(&standing, from, free)?;
        let (mut steps, mut way) = (0, 0);
        loop {
            let moved = if steps < effort.steps {
                self.step(&setting, &standing, &scored, &mut way, counts)
            } else {
                None
            };
            steps += 1;
            if let Some(next) = moved {
                standing = next;
                from = (scored.scales, scored.tau);
                scored = tuned(&standing, from, free)?;
                continue;
            }
            if !free || standing.gram.has_unknown() {
                break;
            }
            // at the optimum without it: does its evidence want it?
            if !self.bench.add_unknown(&setting, &standing.point, &mut standing.columns, counts) {
                break;
            }
            standing.gram = self.gram(&setting, &standing.point, &standing.columns, &[]);
            scored = tuned(&standing, (scored.scales, scored.tau), free)?;
            if scored.scales == OFF || scored.ln_z < effort.least {
                break;
            }
        }
        let (scored, shortfall) = self.judged(&setting, &standing, scored, free)?;
        let Standing { point, columns, gram } = standing;
        let fitted = Fitted { setting, point, gram, scored, shortfall, is_expanded: false, is_free: free };
        Some((fitted, columns))
    }

    /// What is to be said of `standing`, where `scored` is what all that is linear says without bounds: what bounds hold stays, and what was not
    /// reached does not count. And by how much that is less.
    fn judged(
        &self,
        setting: &Setting,
        standing: &Standing,
        scored: Scored,
        free: bool,
    ) -> Option<(Scored, f64)> {
        let Setting { set, columns, .. } = setting;
        let held = self.held(setting, standing, &scored);
        if held.is_empty() {
            let unreached = self.unreached(setting, &standing.point, &standing.gram, &scored);
            return Some((Scored { ln_z: scored.ln_z - unreached, ..scored }, unreached));
        }
        let gram = self.gram(setting, &standing.point, &standing.columns, &held);
        let mut bounded = self.scorer(&gram).tuned(set, columns, (scored.scales, scored.tau), free)?;
        bounded.ln_z -= self.unreached(setting, &standing.point, &gram, &bounded);
        let taus = bounded.tau..bounded.tau + 1;
        let linear = self.scorer(&standing.gram).score(set, columns, bounded.scales, taus)?;
        let shortfall = linear.ln_z - bounded.ln_z;
        Some((bounded, shortfall))
    }

    /// By how much `point` is worse than the optimum that `scored`, from the products `gram` about it, has \[nats\]: a fit that found no way there
    /// has not shown that there is one.
    fn unreached(&self, setting: &Setting, point: &Point, gram: &Gram, scored: &Scored) -> f64 {
        let Some(reduced) = gram.reduced(scored.scales) else { return 0.0 };
        let square = |(x, precision): (f64, f64)| if precision.is_finite() { precision * x * x } else { 0.0 };
        let base = point.base.iter().zip(&self.centres).map(|(x, centre)| x - centre);
        let base = base.zip(gram.beliefs.base.iter().copied()).map(square);
        let starts = point.offsets.iter().flatten().copied();
        let starts = starts.zip(self.beliefs.starts.iter().flatten().copied()).map(square);
        let (mut sizes, mut forbidden, mut place) = (0.0, 0.0, 0);
        for ((column, &size), best) in setting.columns.iter().zip(&point.sizes).zip(&scored.sizes) {
            let Some(best) = *best else { continue };
            sizes += square((size, column.belief.precision(best, super::score::tau(scored.tau))));
            // what the evidence has been charged with already
            if column.is_positive && best < 0.0 {
                forbidden += best * best / scored.covariance[(place, place)];
            }
            place += 1;
        }
        let cost = reduced.cost + base.sum::<f64>() + starts.sum::<f64>() + sizes;
        let believed = UNREACHED_SHARE * cost / scored.variance;
        (0.5 * ((cost - scored.squares) / scored.variance - forbidden - believed)).max(0.0)
    }

    /// One step that costs less, if there is one that is worth it; `way`, a place among [`WAYS`], is where it looks first.
    fn step(
        &self,
        setting: &Setting,
        standing: &Standing,
        scored: &Scored,
        way: &mut usize,
        counts: &mut Counts,
    ) -> Option<Standing> {
        let before = self.cost(setting, standing, scored)?;
        let with_unknown = scored.scales != OFF;
        for place in (*way..WAYS.len()).take(MOST_TRIES) {
            let Standing { point, gram, .. } = standing;
            let [damping, share] = WAYS[place];
            let target = self.damped(setting, point, gram, scored, damping)?;
            if self.promised(setting, standing, &target) < NOT_WORTH_A_STEP {
                return None;
            }
            let next = self.stand(setting, point.towards(&target, share), with_unknown, counts);
            let Some(next) = next else { continue };
            let after = self.cost(setting, &next, scored)?;
            if after < before - NOT_WORTH_A_STEP {
                *way = place.saturating_sub(1);
                return Some(next);
            }
        }
        None
    }

    /// Half the squares, whitened, by which the step to `target` changes what is seen: what it could matter, in nats.
    fn promised(&self, setting: &Setting, standing: &Standing, target: &Point) -> f64 {
        let change = |run: usize| {
            let columns = &standing.columns[run];
            let by = |after: &[f64], before: &[f64]| -> Vec<f64> {
                after.iter().zip(before).map(|(after, before)| after - before).collect()
            };
            let mut all = by(&target.base, &standing.point.base);
            all.extend(by(&target.offsets[run], &standing.point.offsets[run]));
            let mut change = &columns.base * DVector::from_vec(all);
            for (place, column) in setting.columns.iter().enumerate().filter(|(_, c)| c.acts_in(run)) {
                let size = target.sizes[place] - standing.point.sizes[place];
                if let Some((_, slope)) = columns.numbers.iter().find(|(number, _)| *number == column.number)
                {
                    change.axpy(size, slope, 1.0);
                }
            }
            0.5 * change.norm_squared()
        };
        (0..standing.columns.len()).map(change).sum()
    }

    /// Looks at all candidates about `fitted`, whose columns are given.
    pub(super) fn expand(
        &self,
        fitted: &mut Fitted,
        mut columns: Vec<RunColumns>,
        with_unknown: bool,
        counts: &mut Counts,
    ) {
        self.bench.add_candidates(&fitted.setting, &fitted.point, &mut columns, counts);
        if with_unknown && columns.iter().any(|run| run.unknown.is_none()) {
            self.bench.add_unknown(&fitted.setting, &fitted.point, &mut columns, counts);
        }
        fitted.gram = self.gram(&fitted.setting, &fitted.point, &columns, &[]);
        fitted.is_expanded = true;
    }

    /// The point of the model as it stands, fitted.
    pub(super) fn baseline(&self) -> (Point, (Scales, usize)) {
        let state = &self.bench.state;
        let point = Point {
            base: state.point.values.clone(),
            offsets: state.point.offsets.clone(),
            sizes: Vec::new(),
        };
        (point, (OFF, TAU_START))
    }
}

impl Point {
    /// So large a share of the way to `target`.
    fn towards(&self, target: &Self, share: f64) -> Self {
        let between = |from: &[f64], to: &[f64]| -> Vec<f64> {
            from.iter().zip(to).map(|(from, to)| from + share * (to - from)).collect()
        };
        Self {
            base: between(&self.base, &target.base),
            offsets: self.offsets.iter().zip(&target.offsets).map(|(from, to)| between(from, to)).collect(),
            sizes: between(&self.sizes, &target.sizes),
        }
    }
}
