//! `rig calibrate servo`.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use anyhow::anyhow;
use ground::strict::Positive;

use super::progress::Bar;
use super::{Failure, Outcome};
use app::experiment::{Experiment, Extent};
use app::servo::{Found, channel};
use app::{base, interruptible, threads};
use calibrate::servo::{motion, report};
use config::RigConfig;
use config::edit::{self, EditError};
use record::folder::RunFolder;
use record::outputs::{OutputFile, Outputs};
use servo::calibration::ServoCalibration;

/// Arguments of `rig calibrate servo`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// The rig config of a driven run, whose servo MOVES OVER ALL OF ITS CHANNEL'S TRAVEL as fast as the channel may. Or the folder of such
    /// a run, extracted
    #[arg(value_name = "CONFIG|RUN")]
    pub from: PathBuf,
    /// Name of the channel; may be left out where there is one
    #[arg(long, value_name = "NAME")]
    pub channel: Option<String>,
    /// How long the servo stands after each move, in seconds, 0.25 at least; longer for slow servos
    #[arg(long, value_name = "S", default_value = "0.45", value_parser = stand_s)]
    pub stand_s: Positive,
    /// Also write the calibration into this file; or, beside this config, into one that its channel then names; its comments stay
    #[arg(long, value_name = "FILE|CONFIG")]
    pub write: Option<PathBuf>,
    /// Folder of run folders, for the film
    #[arg(long, default_value = "runs")]
    pub runs_dir: PathBuf,
    /// Worker threads; as many as there are cores when left out
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// Least and greatest duration of a stand of the staircase \[s\]: it must settle, and the motion must not take minutes. Chosen.
const STAND_DURATION_RANGE_S: [f64; 2] = [0.25, 10.0];

fn stand_s(text: &str) -> Result<Positive, String> {
    let [least, most] = STAND_DURATION_RANGE_S;
    let seconds = text.parse().ok().filter(|s| (least..=most).contains(s)).and_then(Positive::new);
    seconds.ok_or_else(|| format!("a number between {least} and {most} is wanted"))
}

/// Carries out `rig calibrate servo`.
///
/// # Errors
/// [`Failure`] by class, as `rig run` gives it; data: a film that does not show a staircase.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    // the file to write is checked before anything moves
    let target = args.write.as_deref().map(Target::of).transpose()?;
    let run = match args.from.is_dir() {
        true => RunFolder::open(&args.from).map_err(Failure::input)?,
        false => film(args)?,
    };
    let found = Found::of(&run, args.channel.as_deref())?;
    let calibration = &found.calibration;
    let mut text = format!(
        "run {}\n{}",
        run.path().display(),
        report::text(&found.calibrated, &found.observed, calibration)
    );
    let out = match &target {
        None => None,
        Some(target) => {
            let file = target.write(calibration)?;
            text += &format!("\n{}: written\n", file.display());
            Some(file)
        }
    };
    if out.is_none() {
        text += "\nnothing was written: --write FILE or --write CONFIG keeps it, also from this run\n";
    }
    Ok(Outcome { out, run: Some(run.path().into()), text, ..Outcome::default() })
}

/// Drives the staircase and films it, through the same machinery and limits as any run.
fn film(args: &Args) -> Result<RunFolder, Failure> {
    let config = RigConfig::read(&args.from).map_err(Failure::input)?;
    let (channel, _) = channel(&config, args.channel.as_deref())?;
    let experiment = Experiment {
        config: &config,
        base: base(&args.from),
        runs_dir: &args.runs_dir,
        extent: Extent::Keypoints,
        motion: Some(motion(channel, args.stand_s.get())),
        threads: threads(args.threads),
        announced: false,
    };
    let _claim = experiment.claim()?;
    interruptible(async |interrupt| {
        let done = experiment.carry_out(interrupt, &mut Bar::new(interrupt.flag())).await?;
        Ok(done.conducted.folder)
    })
}

/// What a calibration is written into.
enum Target {
    /// A file of its own.
    File(OutputFile),
    /// A file beside a config, whose channel then names it.
    Config(OutputFile, Box<RigConfig>),
}

impl Target {
    fn of(path: &Path) -> Result<Self, Failure> {
        let written = Outputs::edited(path)?;
        if !path.exists() || ServoCalibration::read(path).is_ok() {
            return Ok(Self::File(written));
        }
        let config = RigConfig::read(path).map_err(|error| {
            let error = anyhow::Error::new(error);
            Failure::Input(error.context("--write wants a rig config, a servo's calibration, or a new file"))
        })?;
        Ok(Self::Config(written, Box::new(config)))
    }

    fn write(&self, calibration: &ServoCalibration) -> Result<PathBuf, Failure> {
        let text = report::toml(calibration).map_err(Failure::internal)?;
        let write = |file: &OutputFile| file.write(text.as_bytes()).map_err(Failure::input);
        match self {
            Self::File(file) => {
                write(file)?;
                Ok(file.path().into())
            }
            Self::Config(edited, config) => {
                let name = &calibration.channel;
                let channel = config
                    .servo
                    .iter()
                    .flat_map(|servo| &servo.channels)
                    .find(|channel| channel.name == *name);
                let named = channel.and_then(|channel| channel.calibration.clone());
                let is_only = config.servo.as_ref().is_some_and(|servo| servo.driven().count() == 1);
                let usual = if is_only { "servo.toml".into() } else { format!("servo-{name}.toml") };
                let file = named.unwrap_or_else(|| usual.into());
                let path = base(edited.path()).join(&file);
                if path.exists() && ServoCalibration::read(&path).is_err() {
                    return Err(Failure::Input(anyhow!(
                        "{} is there and no servo's calibration: write into another file and name it in [[servo.channel]] calibration",
                        path.display()
                    )));
                }
                write(&Outputs::edited(&path)?)?;
                edit::rewrite(edited, |text| {
                    edit::set_servo_calibration(text, name, &file.to_string_lossy())
                })
                .map_err(|error: EditError| Failure::input(error))?;
                Ok(path)
            }
        }
    }
}
