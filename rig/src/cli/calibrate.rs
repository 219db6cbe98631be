//! `rig calibrate`: what is measured once for a rig.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use ground::strict::Positive;

use super::choice::choice;
use super::progress::Bar;
use super::{Failure, Outcome};
use app::latency::{Filmed, by_link};
use app::{base, calibrate::from_pictures, on_threads, threads};
use calibrate::port::Port;
use calibrate::world::Upright;
use calibrate::{Board, Setup, report};
use camera::calibration::{Px, View};
use config::RigConfig;
use config::edit::{self, EditError};
use record::folder::RunFolder;
use record::outputs::Outputs;
use std::sync::Arc;

/// Arguments of `rig calibrate`.
#[derive(clap::Args, Debug)]
pub struct Args {
    /// What to calibrate
    #[command(subcommand)]
    pub what: What,
}

/// What can be calibrated.
#[derive(clap::Subcommand, Debug)]
pub enum What {
    /// Pixels to metres, from pictures of a chessboard or an aprilgrid in the water, in the mechanism's plane of motion
    Camera(Box<CameraArgs>),
    /// How late the camera's stamps are, from the board's sync LED in the picture: films it for a while, or reads a recorded run
    Latency(LatencyArgs),
    /// Where a servo turns for which pulse, and how it follows: drives it up and down a staircase and films its link, or reads a recorded run
    Servo(super::calibrate_servo::Args),
}

/// What tells how late a camera's stamps are.
#[derive(clap::ValueEnum, Debug, Clone, Copy, PartialEq, Eq)]
pub enum By {
    /// The board's sync LED
    Led,
    /// The driven link
    Link,
}

/// Arguments of `rig calibrate latency`.
#[derive(clap::Args, Debug)]
pub struct LatencyArgs {
    /// The rig config, whose camera sees the sync LED; nothing moves. Or a run folder, in whose images it is seen
    #[arg(value_name = "CONFIG|RUN")]
    pub from: PathBuf,
    /// What tells the time: the board's sync LED; or, of an extracted run, the driven link, which leaves some milliseconds open
    #[arg(long, value_enum, default_value = "led")]
    pub by: By,
    /// How long to film, in seconds; 3 at least
    #[arg(long, value_name = "S", default_value = "10", value_parser = positive)]
    pub film_s: Positive,
    /// Also write `latency_s` and `latency_std_s` into this config; its comments stay
    #[arg(long, value_name = "CONFIG")]
    pub write: Option<PathBuf>,
    /// Worker threads; as many as there are cores when left out
    #[arg(long)]
    pub threads: Option<NonZeroUsize>,
}

/// Arguments of `rig calibrate camera`.
#[derive(clap::Args, Debug)]
pub struct CameraArgs {
    /// Folder of pictures, or one picture, of the board IN THE WATER, at several places of the mechanism's plane of motion
    #[arg(value_name = "IMAGES")]
    pub images: PathBuf,
    /// The board. A chessboard: inner corners (where four squares meet) along its sides, and the side of a square in metres. An
    /// aprilgrid as Kalibr prints it (family 36h11, tag 0 at the lower left): tags along its lower side, rows, the side of a tag with
    /// its black border in metres, and the gap between tags as a share of that. Measure what came out of the printer
    #[arg(long, value_name = "chessboard:COLSxROWS:SQUARE_M|aprilgrid:COLSxROWS:TAG_M:SPACING")]
    pub board: Board,
    /// Which plane of the model's world the camera looks at. x-z: from the side, z up in the picture. x-y: from above, y up in the
    /// picture and z towards the camera; trajectories then have the columns P1_x_m,P1_y_m
    #[arg(long, value_parser = choice::<View>(), default_value = "x-z")]
    pub view: View,
    /// Where the world's origin is seen, column and row; the centre of the top left pixel is 0,0
    #[arg(long, value_name = "X,Y", value_parser = numbers::<2>, allow_hyphen_values = true)]
    pub origin_px: Px,
    /// The calibration file to write, for `[calibration] file`
    #[arg(long, value_name = "TOML")]
    pub out: PathBuf,
    /// Two places on a plumb line, the lower and the upper one: z (with --view x-y: y) points from one to the other [default: x along
    /// the picture's rows]
    #[arg(long, value_name = "X1,Y1,X2,Y2", value_parser = numbers::<4>, allow_hyphen_values = true, conflicts_with = "level_px")]
    pub up_px: Option<[f64; 4]>,
    /// Two places on the still surface of the water (from above: on the tank's edge), the left and the right one: x points from one to
    /// the other
    #[arg(long, value_name = "X1,Y1,X2,Y2", value_parser = numbers::<4>, allow_hyphen_values = true)]
    pub level_px: Option<[f64; 4]>,
    /// How much farther from the camera than the board the mechanism's plane lies, in metres; negative: nearer
    #[arg(long, value_name = "D", value_parser = numbers::<1>, allow_hyphen_values = true, requires = "port")]
    pub plane_offset_m: Option<[f64; 1]>,
    /// Metres of air, wall and water between camera and board, for --plane-offset-m
    #[arg(long, value_name = "AIR_M:GLASS_M:WATER_M", requires = "plane_offset_m")]
    pub port: Option<Port>,
    /// Largest root mean square error of a picture, in millimetres; worse ones are refused
    #[arg(long, value_name = "MM", default_value = "0.3", value_parser = positive)]
    pub most_rms_mm: Positive,
    /// Which camera this is, for people
    #[arg(long, value_name = "NAME")]
    pub camera: Option<String>,
}

/// Numbers with commas between them.
fn numbers<const N: usize>(text: &str) -> Result<[f64; N], String> {
    let each = text.split(',').map(|number| number.trim().parse::<f64>().ok().filter(|x| x.is_finite()));
    let numbers = each.collect::<Option<Vec<f64>>>().and_then(|numbers| numbers.try_into().ok());
    numbers.ok_or_else(|| format!("{N} numbers are wanted, with commas between them"))
}

fn positive(text: &str) -> Result<Positive, String> {
    text.parse().ok().and_then(Positive::new).ok_or_else(|| "a number above 0 is wanted".into())
}

/// Carries out `rig calibrate`.
///
/// # Errors
/// Input: pictures that cannot be read or of different sizes. Data: no board, too little of the picture covered, too large an error.
pub fn run(args: &Args) -> Result<Outcome, Failure> {
    match &args.what {
        What::Camera(args) => camera(args),
        What::Latency(args) => latency(args),
        What::Servo(args) => super::calibrate_servo::run(args),
    }
}

fn latency(args: &LatencyArgs) -> Result<Outcome, Failure> {
    let written = args.write.as_deref().map(Outputs::edited).transpose()?;
    let (found, latency_s, std_s) = match args.by {
        By::Led => by_led(args)?,
        By::Link => {
            let run = RunFolder::open(&args.from).map_err(|error| {
                Failure::input(
                    anyhow::Error::new(error).context("--by link wants a run folder, of a driven run"),
                )
            })?;
            let measured = by_link(&run)?;
            (measured.to_string(), measured.latency_s, measured.std_s)
        }
    };
    let rounded = |seconds: f64| (seconds * 1e6).round() / 1e6;
    let (latency_s, std_s) = (rounded(latency_s), rounded(std_s));
    if let Some(config) = &written {
        edit::rewrite(config, |text| {
            let text = edit::set(text, "camera", "latency_s", latency_s.into())?;
            edit::set(&text, "camera", "latency_std_s", std_s.into())
        })
        .map_err(|error: EditError| Failure::input(error))?;
    }
    let written = args.write.as_ref().map_or_else(
        || "for the table [camera] of the config:".to_owned(),
        |path| format!("{}: written into [camera]:", path.display()),
    );
    let text = format!(
        "{found}\n{written}\nlatency_s = {latency_s}\nlatency_std_s = {std_s}\n\
         It holds for this camera, size, format, rate and exposure: after a change of any, measure again.\n"
    );
    Ok(Outcome { out: args.write.clone(), text, ..Outcome::default() })
}

/// What was found, in words, the latency and its standard deviation \[s\].
fn by_led(args: &LatencyArgs) -> Result<(String, f64, f64), Failure> {
    let mut bar = Bar::new(Arc::default());
    let filmed = match args.from.is_dir() {
        true => Filmed::of(&RunFolder::open(&args.from).map_err(Failure::input)?, &mut bar)?,
        false => {
            let config = RigConfig::read(&args.from).map_err(Failure::input)?;
            Filmed::now(&config, base(&args.from), args.film_s.get(), &mut bar)?
        }
    };
    let measured = filmed.measured(threads(args.threads))?;
    let text = format!(
        "{}\nthe config took back {:.2} ms; clock of the board known to {:.2} ms, which is in the servo's times too and cancels",
        measured.beyond,
        measured.configured_s * 1e3,
        measured.clock_sigma_s * 1e3,
    );
    Ok((text, measured.latency_s, measured.beyond.std_s))
}

fn camera(args: &CameraArgs) -> Result<Outcome, Failure> {
    let out = Outputs::reading([args.images.clone()]).file(&args.out)?;
    let upright = match (args.up_px, args.level_px) {
        (Some([x1, y1, x2, y2]), _) => Upright::Plumb([[x1, y1], [x2, y2]]),
        (None, Some([x1, y1, x2, y2])) => Upright::Level([[x1, y1], [x2, y2]]),
        (None, None) => Upright::Rows,
    };
    let setup = Setup {
        board: args.board,
        view: args.view,
        origin_px: args.origin_px,
        upright,
        offset: args.plane_offset_m.map(|[behind_m]| behind_m).zip(args.port),
        most_rms_m: args.most_rms_mm.get() * 1e-3,
    };
    let mut bar = Bar::new(Arc::default());
    let calibrated = on_threads(threads(None), || from_pictures(&args.images, &setup, &mut bar))?;
    let date = jiff::Timestamp::now().strftime("%Y-%m-%dT%H:%M:%SZ").to_string();
    let file = report::toml(&calibrated, &date, args.camera.as_deref());
    out.write(file.as_bytes()).map_err(Failure::input)?;
    let text = format!(
        "{}{}: for a rig config's [calibration] file, instead of metres_per_pixel and origin_px\n",
        report::text(&calibrated),
        args.out.display()
    );
    Ok(Outcome { out: Some(args.out.clone()), text, ..Outcome::default() })
}
