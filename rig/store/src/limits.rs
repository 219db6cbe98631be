//! What a queue takes: texts, lists and the queue itself have bounds, whoever adds.

use super::job::{NewJob, Work};

/// Characters of a reason: it is read in a list.
const WHY_CHARS: usize = 200;
/// Characters of a parameter's name.
const NAME_CHARS: usize = 200;
/// Runs that a job is about.
const RUNS: usize = 1000;
/// Runs that a campaign may make.
const CAMPAIGN_RUNS: usize = 1000;
/// Parameters that a campaign is to find out.
const GOALS: usize = 100;
/// Jobs that wait.
pub(super) const WAITING: u32 = 1000;

/// What was asked for is too much.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Limit {
    /// The reason.
    #[error("`why` has {0} characters, {WHY_CHARS} are the most: say it shorter")]
    Why(usize),
    /// The runs of a job.
    #[error("{0} runs in one job, {RUNS} are the most: leave out those that say the same")]
    Runs(usize),
    /// The runs of a campaign.
    #[error("`max_runs` = {0} is not between 1 and {CAMPAIGN_RUNS}")]
    CampaignRuns(usize),
    /// The goals of a campaign.
    #[error(
        "{0} goals, {GOALS} are the most, each of a parameter whose name has at most {NAME_CHARS} characters"
    )]
    Goals(usize),
    /// The queue.
    #[error("{0} jobs wait, {WAITING} are the most: cancel some, or wait until some are done")]
    Waiting(u32),
}

/// The reason for which something is to end, cut where it is too long: no end is refused for its words.
pub(super) fn cut(why: &str) -> String {
    match why.char_indices().nth(WHY_CHARS) {
        None => why.into(),
        Some((end, _)) => format!("{} ... ({} characters)", &why[..end], why.chars().count()),
    }
}

impl NewJob {
    /// Whether it is within all bounds but that of the queue.
    ///
    /// # Errors
    /// [`Limit`].
    pub(super) fn check(&self) -> Result<(), Limit> {
        let said = self.why.as_ref().map_or(0, |why| why.chars().count());
        if said > WHY_CHARS {
            return Err(Limit::Why(said));
        }
        match &self.work {
            Work::Campaign { max_runs, .. } if !(1..=CAMPAIGN_RUNS).contains(max_runs) => {
                Err(Limit::CampaignRuns(*max_runs))
            }
            Work::Campaign { goals, .. }
                if goals.len() > GOALS || goals.iter().any(|goal| goal.name.chars().count() > NAME_CHARS) =>
            {
                Err(Limit::Goals(goals.len()))
            }
            work if work.runs().len() > RUNS => Err(Limit::Runs(work.runs().len())),
            _ => Ok(()),
        }
    }
}
