//! The missing images of a run: those that the camera lost, those that are damaged, and those that can no longer be read.

use serde::{Deserialize, Serialize};
use utoipa::ToSchema;

use super::folder::{RunFolder, file};
use super::frames::{self, FrameRow};
use super::start_stop::Stop;

/// Images of a run. `received` = those with a row + `unread`; what `lost` counts was never received.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize, ToSchema)]
pub struct Losses {
    /// Received, as `stop.json` says.
    pub received: u64,
    /// Counted by the camera and never received, or received and not recorded.
    pub lost: u64,
    /// Received and recorded, but no longer readable in the recording.
    pub unread: u64,
    /// Marked as damaged, or not whole.
    pub damaged: u64,
    /// The most images missing in a row.
    pub longest_gap: u64,
}

impl Losses {
    /// Those of `run`, by its `stop.json` and `frames.csv`.
    pub fn of(run: &RunFolder) -> Self {
        let path = run.file(file::FRAMES);
        match run.stop() {
            // without lost images the number of rows is enough
            Some(stop) if stop.images_lost == 0 => {
                let rows = frames::count(&path).unwrap_or(stop.images);
                Self::of_stop(stop, rows)
            }
            _ => Self::by(run, frames::read(&path).ok().as_deref()),
        }
    }

    /// The same, with the `rows` of what was looked at, where there are any.
    pub fn by(run: &RunFolder, rows: Option<&[FrameRow]>) -> Self {
        let gaps = rows.unwrap_or_default().iter().map(|row| u64::from(row.lost_before));
        let damaged = rows.unwrap_or_default().iter().filter(|row| row.damaged).count() as u64;
        let longest_gap = gaps.clone().max().unwrap_or(0);
        let count = rows.map(|rows| rows.len() as u64);
        match run.stop() {
            Some(stop) => Self { longest_gap, ..Self::of_stop(stop, count.unwrap_or(stop.images)) },
            None => Self { received: count.unwrap_or(0), lost: gaps.sum(), unread: 0, damaged, longest_gap },
        }
    }

    /// The losses that `stop` states, where `rows` images could be read.
    fn of_stop(stop: &Stop, rows: u64) -> Self {
        Self {
            received: stop.images.max(rows),
            lost: stop.images_lost + stop.messages_dropped,
            unread: stop.images.saturating_sub(rows),
            damaged: stop.images_damaged,
            longest_gap: 0,
        }
    }

    /// The share of all images that is missing.
    pub fn share(&self) -> f64 {
        let all = self.received + self.lost;
        if all == 0 { 0.0 } else { (self.lost + self.unread + self.damaged) as f64 / all as f64 }
    }

    /// What is missing, as a sentence without its full stop; `None` where nothing is.
    pub fn say(&self) -> Option<String> {
        let all = self.received + self.lost;
        let missing = self.lost + self.unread + self.damaged;
        let kinds = [
            (self.lost, "lost before they were recorded"),
            (self.unread, "lost from the recording"),
            (self.damaged, "damaged"),
        ];
        let kinds: Vec<String> = kinds
            .iter()
            .filter(|(count, _)| *count > 0)
            .map(|(count, what)| format!("{count} {what}"))
            .collect();
        (missing > 0).then(|| format!("{missing} of {all} images are missing: {}", kinds.join(", ")))
    }

    /// Why the run is degraded, where it lacks more images than `limits` allow: nothing is promoted from it.
    pub fn degraded(&self, limits: &Limits) -> Option<String> {
        let Limits { max_lost_share, max_gap_images } = limits;
        let said = self.say()?;
        if self.share() > *max_lost_share {
            return Some(format!("{said}; more than {} % ([run] max_lost_share)", 100.0 * max_lost_share));
        }
        (self.longest_gap > *max_gap_images).then(|| {
            format!(
                "{said}; {} in a row, more than {max_gap_images} ([run] max_gap_images)",
                self.longest_gap
            )
        })
    }
}

/// What a run may lack and still be promoted: the keys of a config's `[run]` table.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
#[serde(default)]
pub struct Limits {
    /// The largest share of all images that may be missing.
    pub max_lost_share: f64,
    /// The most images that may be missing in a row.
    pub max_gap_images: u64,
}

impl Default for Limits {
    fn default() -> Self {
        Self { max_lost_share: 0.01, max_gap_images: 3 }
    }
}

impl Limits {
    /// The limits in the config that `run` was made with.
    pub fn of(run: &RunFolder) -> Self {
        #[derive(Deserialize)]
        struct MadeWith {
            run: Limits,
        }
        // the defaults where the config can no longer be read
        toml::from_str::<MadeWith>(&run.start().config).map_or_else(|_| Self::default(), |made| made.run)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn share_counts_all_that_is_missing_once_and_limits_are_told_with_their_keys() {
        let limits = Limits::default();
        let whole = Losses { received: 600, ..Losses::default() };
        assert_eq!((whole.say(), whole.degraded(&limits)), (None, None));
        let few = Losses { received: 594, lost: 6, longest_gap: 3, ..whole };
        assert!((few.share() - 0.01).abs() < 1e-12);
        assert_eq!(few.degraded(&limits), None, "as many as are allowed");
        let many = Losses { received: 582, unread: 74, damaged: 1, ..whole };
        let said = many.degraded(&limits).unwrap();
        assert!(
            said.starts_with("75 of 582 images are missing: 74 lost from the recording, 1 damaged"),
            "{said}"
        );
        assert!(said.contains("1 % ([run] max_lost_share)"), "{said}");
        let in_a_row = Losses { longest_gap: 4, ..few };
        assert!(
            in_a_row.degraded(&limits).unwrap().contains("4 in a row, more than 3 ([run] max_gap_images)")
        );
    }
}
