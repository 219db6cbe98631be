//! `rig import`: keypoints that other programs found, to a trajectory.

use std::path::PathBuf;

use super::choice::choice;
use super::{Failure, Outcome};
use app::exchange::{Import, ImportOutcome, TableOfImages, frames_file};
use config::paths;
use interchange::Format;
use record::outputs::Outputs;
use vision::Status;

/// Keypoints that other programs found, to a trajectory that `rig fit` reads.
#[derive(clap::Args, Debug)]
#[command(allow_missing_positional = true)]
pub struct Args {
    /// Its format; left out: told by how the file begins
    #[arg(value_parser = choice::<Format>(), value_name = "FORMAT")]
    pub format: Option<Format>,
    /// The other program's file
    #[arg(value_name = "FILE")]
    pub file: PathBuf,
    /// Any rig config; only its `[calibration]`, `[camera]` fps, and for lines `[vision]` and the model of `[run]` are used
    #[arg(long, value_name = "TOML")]
    pub config: PathBuf,
    /// The mechanism's MuJoCo model, which says where on a WCON line the keypoints are; left out: `[vision]`, or the model of `[run]`
    #[arg(long, value_name = "MODEL.xml")]
    pub model: Option<PathBuf>,
    /// The trajectory to write; each image's status goes to `<out>.frames.csv`
    #[arg(long, value_name = "CSV")]
    pub out: PathBuf,
    /// Body parts that are P0, P1, ...: `a,b,c`, or `P1=a,P2=b`; of WCON the ids that are a keypoint each. Left out: those called P0, P1, ...
    #[arg(long, value_name = "PARTS")]
    pub keypoints: Option<String>,
    /// Of several animals this one: DeepLabCut's individual, SLEAP's track, WCON's id
    #[arg(long, value_name = "NAME", visible_aliases = ["track", "id"])]
    pub individual: Option<String>,
    /// Images per second; left out: `[camera]` fps
    #[arg(long, value_name = "HZ", allow_negative_numbers = true)]
    pub fps: Option<f64>,
    /// When images were taken, as `file,time_s`, where they are not evenly spaced; left out: `<FILE>.frames.csv`, if there is one
    #[arg(long, value_name = "CSV", conflicts_with = "fps")]
    pub times: Option<PathBuf>,
    /// A mark that its tracker thinks less likely is left out
    #[arg(long, value_name = "SHARE", default_value_t = 0.6, allow_negative_numbers = true)]
    pub least_likelihood: f64,
    /// Sigma of a mark per axis, in pixels. Trackers do not give it; left out: none is written, and a fit takes the noise from the keypoints
    #[arg(long, value_name = "PX", allow_negative_numbers = true)]
    pub std_px: Option<f64>,
    /// The y of a WCON file grows downward, as rows of a picture do; the format leaves it open
    #[arg(long)]
    pub y_down: bool,
}

/// Carries out `rig import`.
///
/// # Errors
/// As [`Import::carry_out`].
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    let read = [args.file.clone(), frames_file(&args.file)].into_iter();
    let read = read.chain(args.times.clone()).chain(args.model.clone()).chain(paths::files(&args.config));
    let out = TableOfImages::at(&args.out, &mut Outputs::reading(read))?;
    let import = Import {
        file: &args.file,
        format: args.format,
        config: &args.config,
        model: args.model.as_deref(),
        out: &out,
        keypoints: args.keypoints.as_deref(),
        individual: args.individual.as_deref(),
        fps: args.fps,
        times: args.times.as_deref(),
        least_likelihood: args.least_likelihood,
        std_px: args.std_px,
        y_down: args.y_down,
    };
    let outcome = import.carry_out()?;
    Ok(Outcome { out: Some(args.out.clone()), text: summary(args, &outcome), ..Outcome::default() })
}

fn summary(args: &Args, ImportOutcome { imported, format, notes }: &ImportOutcome) -> String {
    let [ok, doubtful, rejected] =
        [Status::Ok, Status::Doubtful, Status::Rejected].map(|status| imported.count(status));
    let notes: String = notes.iter().map(|note| format!("{note}\n")).collect();
    format!(
        "{}{}: {}, {} images from {}: {ok} with all of them, {doubtful} with some, {rejected} with none; reasons in {}\n",
        notes,
        args.out.display(),
        imported.trajectory.keypoints.join(", "),
        imported.images.len(),
        format.name(),
        frames_file(&args.out).display()
    )
}
