//! The search as a whole: a first look, and further ones where the first may have misled.

use super::DiagnoseError;
use super::baseline::{self, Stamps, seen_floor};
use super::gates::goodness_of_fit;
use super::rivals::stands_in;
use super::sets::{FAR_BENT_COST, Found, MOST_CAUSES, Search};
use crate::hypothesis::state::State;
use crate::noise::floor::Floor;

/// What a search has come to.
#[derive(Clone)]
pub(super) struct Standing<'a> {
    pub(super) baseline: State<'a>,
    pub(super) floor: Floor,
    pub(super) found: Found<'a>,
}

impl Standing<'_> {
    fn explained(&self) -> f64 {
        self.baseline.cost - self.found.leader.cost
    }

    fn is_clear(&self) -> bool {
        self.found.is_clear(&self.baseline)
    }
}

impl Search<'_> {
    /// The best set of causes beside `baseline`. A search that is ended early has what it found by then.
    pub(super) fn seek<'a>(
        &mut self,
        baseline: State<'a>,
        floor: Floor,
    ) -> Result<Standing<'a>, DiagnoseError> {
        let found = self.run(&baseline);
        let mut standing = Standing { baseline, floor, found };
        if !standing.found.leader.causes.is_empty() {
            standing = self.unless_cut(standing, Self::go_deeper)?;
            standing = self.unless_cut(standing, |search, standing| {
                let is_clear = standing.is_clear();
                search.with_noise_seen(standing, is_clear)
            })?;
        }
        let explained = standing.explained();
        let left = goodness_of_fit(&standing.found.leader, &standing.floor);
        let objected = left.objects(explained, &standing.floor, standing.baseline.count());
        let doubtful = stands_in(&standing.found.leader) || !standing.is_clear();
        if objected || explained > FAR_BENT_COST && doubtful {
            let most = if objected { MOST_CAUSES } else { standing.found.leader.causes.len() };
            // what it finds in time is better, however early it is ended
            self.run_anew(&standing.baseline, &mut standing.found, most);
            standing =
                self.unless_cut(standing, |search, standing| search.with_noise_seen(standing, true))?;
        }
        if explained > FAR_BENT_COST && self.settle(&standing.baseline, &mut standing.found) {
            standing =
                self.unless_cut(standing, |search, standing| search.with_noise_seen(standing, true))?;
        }
        if !standing.found.leader.causes.is_empty() && !self.is_cut() {
            self.says("asking where it sits");
            self.place(&standing.baseline, &mut standing.found);
        }
        Ok(standing)
    }

    /// The same once more beside a deeper optimum of the baseline, where there is one.
    fn go_deeper<'a>(&mut self, standing: Standing<'a>) -> Result<Standing<'a>, DiagnoseError> {
        let everywhere = !standing.is_clear();
        let (known, leader) = (&standing.baseline, &standing.found.leader);
        let deeper = baseline::deeper(known, leader, everywhere, self.experiment.fit.seed, &mut self.counts);
        let Some(mut baseline) = deeper else { return Ok(standing) };
        let floor = seen_floor(&baseline, Stamps::Exact)?;
        self.weigh(&mut baseline, &floor);
        let found = self.run(&baseline);
        Ok(Standing { baseline, floor, found })
    }

    /// `standing` after `step`; as it was where the search is ended in the midst of it, which leaves things half done.
    fn unless_cut<'a>(
        &mut self,
        standing: Standing<'a>,
        step: impl FnOnce(&mut Self, Standing<'a>) -> Result<Standing<'a>, DiagnoseError>,
    ) -> Result<Standing<'a>, DiagnoseError> {
        if self.is_cut() {
            return Ok(standing);
        }
        let known = standing.clone();
        let next = step(self, standing);
        if self.is_cut() {
            self.floor = known.floor.clone();
            return Ok(known);
        }
        next
    }
}
