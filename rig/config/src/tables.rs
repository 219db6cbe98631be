//! The `[run]`, `[mechanism]`, `[water]`, `[motion]`, `[schedule]` and `[mock]` tables of a rig config.

use std::collections::BTreeMap;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::time::Duration;

use ground::strict::{Finite, NonNegative, Positive, PositiveSeconds, Seconds, Share};
use jiff::Zoned;
use jiff::tz::TimeZone;
use serde::{Deserialize, Serialize};

use super::webhook::Webhook;
use crate::schedule::ScheduleError;
use record::losses::Limits;

/// What moves the mechanism.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum MotionKind {
    /// At rest, then let go by hand: no board is needed.
    Drop,
    /// The servo plays the profile.
    Driven,
}

impl std::fmt::Display for MotionKind {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Drop => "drop",
            Self::Driven => "driven",
        })
    }
}

/// The `[run]` table: one experiment.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunConfig {
    /// What the experiment is called in reports.
    pub name: String,
    /// `driven` or `drop`.
    pub kind: MotionKind,
    /// The MJCF model to fit, relative to the config.
    pub model: PathBuf,
    /// Driven runs only: the actuated joint follows the command exactly.
    #[serde(default)]
    pub prescribed: bool,
    /// How long the picture must be still before anything moves \[s\].
    #[serde(default = "default_settle")]
    pub settle_s: Seconds,
    /// Driven: how long to film on after the profile's end. Drop: after the release \[s\].
    pub film_s: PositiveSeconds,
    /// Drop: how long to wait for the hand \[s\].
    #[serde(default = "default_release_timeout")]
    pub release_timeout_s: PositiveSeconds,
    /// Still means that less than this share of the picture's pixels changes.
    #[serde(default = "default_still_share")]
    pub still_share: Share,
    /// The length that errors are stated in percent of \[m\].
    #[serde(default = "default_length")]
    pub characteristic_length_m: Positive,
    /// Whether the fit is followed by a diagnosis, which takes long for a mechanism of many segments.
    #[serde(default = "default_diagnose")]
    pub diagnose: bool,
    /// The largest share of its images that a run may lack, lost or damaged, before nothing is promoted that was made from it.
    #[serde(default = "default_max_lost_share")]
    pub max_lost_share: Share,
    /// The same in a row: so many images at most.
    #[serde(default = "default_max_gap_images")]
    pub max_gap_images: u64,
}

fn default_max_lost_share() -> Share {
    Share::literal(Limits::default().max_lost_share)
}

fn default_max_gap_images() -> u64 {
    Limits::default().max_gap_images
}

const fn default_diagnose() -> bool {
    true
}

const fn default_settle() -> Seconds {
    Seconds::literal(0.5)
}

const fn default_release_timeout() -> PositiveSeconds {
    PositiveSeconds::literal(60.0)
}

const fn default_still_share() -> Share {
    Share::literal(5e-4)
}

const fn default_length() -> Positive {
    Positive::literal(0.08)
}

/// The `[mechanism]` table: what is known about the mechanism by other means than the video.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MechanismConfig {
    /// How it hangs: decides nothing, is reported.
    pub mount: Option<Mount>,
    /// Weight in air by body \[kg\].
    #[serde(default)]
    pub dry_mass_kg: BTreeMap<String, Positive>,
    /// Apparent weight in water by body \[kg\]; negative floats.
    #[serde(default)]
    pub wet_mass_kg: BTreeMap<String, Finite>,
    /// Standard deviation of the balance \[kg\].
    pub std_kg: Option<Positive>,
}

impl MechanismConfig {
    /// What of it matters to a fit.
    pub fn weights(&self) -> ident::weights::Mechanism {
        ident::weights::Mechanism {
            mount: None,
            dry_mass_kg: self.dry_mass_kg.clone(),
            wet_mass_kg: self.wet_mass_kg.clone(),
            std_kg: self.std_kg,
        }
    }
}

/// How a mechanism is mounted.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Mount {
    /// From above.
    Hanging,
    /// Motor at the bottom.
    Upright,
    /// In a horizontal plane, filmed from above.
    Horizontal,
}

/// The `[water]` table.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WaterConfig {
    /// Temperature \[°C\].
    pub temperature_c: Option<Finite>,
    /// Salinity \[g/kg\].
    pub salinity_g_per_kg: Option<NonNegative>,
}

impl WaterConfig {
    /// The same as a fit knows it.
    pub fn water(&self) -> ident::weights::Water {
        ident::weights::Water { temperature_c: self.temperature_c, salinity_g_per_kg: self.salinity_g_per_kg }
    }
}

/// The `[schedule]` table: when `rig daemon` runs the experiment.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ScheduleConfig {
    /// A cron expression, optionally with seconds in front.
    pub cron: String,
    /// Its time zone, for example `Europe/Zurich`; left out: the machine's.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub time_zone: Option<String>,
    /// How long the water is left alone after any motion \[s\].
    #[serde(default)]
    pub rest_s: Option<Seconds>,
    /// A slot that was missed is made up for when it is no older than this \[s\]; of several only the newest.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub catch_up_s: Option<Seconds>,
    /// What becomes of a slot that comes while the rig is busy.
    #[serde(default)]
    pub overlap: Overlap,
    /// Times of the day at which the schedule begins nothing, for example `22:00-07:00`; jobs added by hand run all the same.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub quiet: Vec<QuietHours>,
}

impl ScheduleConfig {
    /// The time zone of its times.
    ///
    /// # Errors
    /// [`ScheduleError::Zone`].
    pub fn zone(&self) -> Result<TimeZone, ScheduleError> {
        match &self.time_zone {
            None => Ok(TimeZone::system()),
            Some(name) => TimeZone::get(name)
                .map_err(|error| ScheduleError::Zone { name: name.clone(), why: error.to_string() }),
        }
    }

    /// Whether nothing is begun at `time` that no person has asked for.
    pub fn is_quiet(&self, time: &Zoned) -> bool {
        self.quiet.iter().any(|quiet| quiet.contains(time.time()))
    }
}

/// The `[motion]` table: what is looked at before a motion that a daemon or a campaign begins.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct MotionConfig {
    /// It is announced for so long, and can be stopped before it begins \[s\]; left out: 10 s where the servo is on a port, 0 where all of
    /// it is simulated within the program.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub announce_s: Option<Seconds>,
    /// No more motions than this begin within an hour.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub most_per_hour: Option<NonZeroUsize>,
    /// After so many motions in a row that hardware has ended the rig is held.
    pub failures_to_hold: NonZeroUsize,
}

impl Default for MotionConfig {
    fn default() -> Self {
        Self { announce_s: None, most_per_hour: None, failures_to_hold: FAILURES_TO_HOLD }
    }
}

const FAILURES_TO_HOLD: NonZeroUsize = NonZeroUsize::new(3).unwrap();
/// Long enough to take a hand out of the water.
const ANNOUNCE: Duration = Duration::from_secs(10);
/// A motion each minute: what repeats quicker has run wild.
const MOST_PER_HOUR: usize = 60;

impl MotionConfig {
    /// How long a motion is announced; where nobody can be near, as told by `is_simulated`, not at all.
    pub fn announce(&self, is_simulated: bool) -> Duration {
        let default = if is_simulated { Duration::ZERO } else { ANNOUNCE };
        self.announce_s.map_or(default, Seconds::duration)
    }

    /// The most motions within an hour, if there is a bound.
    pub fn most_per_hour(&self, is_simulated: bool) -> Option<usize> {
        let default = (!is_simulated).then_some(MOST_PER_HOUR);
        self.most_per_hour.map(NonZeroUsize::get).or(default)
    }
}

/// The `[alerts]` table: whom a daemon tells that somebody should look.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct AlertsConfig {
    /// A program with its arguments: it gets the alert as JSON on standard input, its kind in the variable `RIG_ALERT`, its words in
    /// `RIG_ALERT_TEXT`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub command: Vec<String>,
    /// An address that the alert is posted to as JSON.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub webhook: Option<Webhook>,
}

impl AlertsConfig {
    /// The place that is a program.
    pub const COMMAND: &str = "command";
    /// The place that is an address.
    pub const WEBHOOK: &str = "webhook";

    /// The places that alerts are delivered to.
    pub fn places(&self) -> Vec<&'static str> {
        let command = (!self.command.is_empty()).then_some(Self::COMMAND);
        let webhook = self.webhook.as_ref().map(|_| Self::WEBHOOK);
        command.into_iter().chain(webhook).collect()
    }
}

/// The `[retention]` table: what `rig daemon` deletes. Without it, nothing.
#[derive(Debug, Clone, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RetentionConfig {
    /// The newest so many runs keep their recordings; of older ones everything else is kept. A number and no age: a clock that jumps
    /// deletes nothing.
    pub keep_recordings: NonZeroUsize,
}

/// What becomes of a slot that comes while the rig is busy or the water not at rest.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Overlap {
    /// It passes.
    #[default]
    Skip,
    /// Its run waits for its turn; one at most.
    Queue,
}

/// A time of the day from one minute to before another, over midnight where the second is earlier.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct QuietHours {
    from: jiff::civil::Time,
    to: jiff::civil::Time,
}

impl QuietHours {
    /// Whether `time` lies in it.
    pub fn contains(self, time: jiff::civil::Time) -> bool {
        match self.from <= self.to {
            true => self.from <= time && time < self.to,
            false => self.from <= time || time < self.to,
        }
    }
}

impl TryFrom<String> for QuietHours {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let time = |text: &str| jiff::civil::Time::strptime("%H:%M", text.trim()).ok();
        let both = text.split_once('-').and_then(|(from, to)| Some((time(from)?, time(to)?)));
        let (from, to) =
            both.ok_or_else(|| format!("quiet hours `{text}` are not of the form 22:00-07:00"))?;
        if from == to {
            return Err(format!(
                "quiet hours `{text}` end where they begin, which may be never or all day: leave them out, or leave out [schedule]"
            ));
        }
        Ok(Self { from, to })
    }
}

impl From<QuietHours> for String {
    fn from(hours: QuietHours) -> Self {
        format!("{}-{}", hours.from.strftime("%H:%M"), hours.to.strftime("%H:%M"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quiet_hours_that_end_where_they_begin_are_refused() {
        let hours = |text: &str| QuietHours::try_from(text.to_owned());
        assert!(hours("22:00-07:00").is_ok() && hours("22:00-22:01").is_ok());
        for text in ["22:00-22:00", "00:00-00:00", " 7:00 - 07:00"] {
            assert!(hours(text).unwrap_err().contains("end where they begin"), "{text}");
        }
    }
}
