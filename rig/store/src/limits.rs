//! Limits of texts, lists and the queue itself.

use super::job::{NewJob, Work};

/// Characters of a reason at most: it is read in a list. Chosen.
const REASON_MAX_CHARS: usize = 200;
/// Characters of a parameter's name at most. Chosen.
const NAME_MAX_CHARS: usize = 200;
/// Runs of a job at most. Chosen.
const JOB_RUNS_MAX: usize = 1000;
/// Runs of a campaign at most. Chosen.
const CAMPAIGN_RUNS_MAX: usize = 1000;
/// Goal parameters of a campaign at most. Chosen.
const CAMPAIGN_GOALS_MAX: usize = 100;
/// Waiting jobs at most. Chosen.
pub(super) const WAITING_JOBS_MAX: u32 = 1000;

/// A limit that a request exceeds.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum Limit {
    /// The reason.
    #[error("`why` has {0} characters, {REASON_MAX_CHARS} are the most: say it shorter")]
    Why(usize),
    /// The runs of a job.
    #[error("{0} runs in one job, {JOB_RUNS_MAX} are the most: leave out those that repeat others")]
    Runs(usize),
    /// The runs of a campaign.
    #[error("`max_runs` = {0} is not between 1 and {CAMPAIGN_RUNS_MAX}")]
    CampaignRuns(usize),
    /// The goals of a campaign.
    #[error(
        "{0} goals, {CAMPAIGN_GOALS_MAX} are the most, each of a parameter whose name has at most {NAME_MAX_CHARS} characters"
    )]
    Goals(usize),
    /// The queue.
    #[error("{0} jobs wait, {WAITING_JOBS_MAX} are the most: cancel some, or wait until some are done")]
    Waiting(u32),
}

/// The reason for which something is to end, cut where it is too long: no end is refused for its words.
pub(super) fn cut(why: &str) -> String {
    match why.char_indices().nth(REASON_MAX_CHARS) {
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
        let characters = self.why.as_ref().map_or(0, |why| why.chars().count());
        if characters > REASON_MAX_CHARS {
            return Err(Limit::Why(characters));
        }
        match &self.work {
            Work::Campaign { max_runs, .. } if !(1..=CAMPAIGN_RUNS_MAX).contains(max_runs) => {
                Err(Limit::CampaignRuns(*max_runs))
            }
            Work::Campaign { goals, .. }
                if goals.len() > CAMPAIGN_GOALS_MAX
                    || goals.iter().any(|goal| goal.name.chars().count() > NAME_MAX_CHARS) =>
            {
                Err(Limit::Goals(goals.len()))
            }
            work if work.runs().len() > JOB_RUNS_MAX => Err(Limit::Runs(work.runs().len())),
            _ => Ok(()),
        }
    }
}
