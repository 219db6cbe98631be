//! A recorded run as an MCAP file that Foxglove shows as it is: pictures with what was found in them, the mechanism in space, servos and
//! events over time.

mod bag;
mod holdings;
mod rows;

use std::io::Cursor;
use std::path::Path;

use anyhow::Context as _;
use image::DynamicImage;
use image::codecs::jpeg::JpegEncoder;
use serde_json::{Value, json};

use super::Failure;
use bag::{Bag, IMAGE, TELEMETRY};
use camera::{CameraImage, Encoding, Rising, decode};
use holdings::RunData;
use interchange::foxglove;
use record::folder::{RunFolder, file};
use record::outputs::OutputFile;
use record::reader::{Item, Recording};
use servo::ServoEvent;

/// JPEG quality of pictures that the camera sent as they are.
const JPEG_QUALITY: u8 = 90;

/// Writes `run` to `out`; what was left out comes back, a sentence each.
///
/// # Errors
/// [`Failure::Input`] where the run or `out` cannot be read or written.
pub fn export(run: &Path, out: &OutputFile) -> Result<Vec<String>, Failure> {
    let run = RunFolder::open(run).map_err(Failure::input)?;
    let (run_data, left_out) = RunData::read(&run)?;
    let writing = || format!("writing {}", out.path().display());
    let part = out.begin().map_err(Failure::input)?;
    let mut bag = Bag::new(part).with_context(writing).map_err(Failure::Input)?;
    run_data.write(&run, &mut bag)?;
    bag.finish().with_context(writing).map_err(Failure::Input)?;
    Ok(left_out)
}

impl RunData {
    fn write(mut self, run: &RunFolder, bag: &mut Bag) -> Result<(), Failure> {
        self.open(bag).map_err(Failure::Internal)?;
        let mut messages = std::mem::take(&mut self.messages).into_iter().peekable();
        let mut until = |bag: &mut Bag, at_ns: u64| -> anyhow::Result<()> {
            while let Some((at_ns, topic, message)) = messages.next_if(|(next, ..)| *next <= at_ns) {
                bag.write(topic, at_ns, &message)?;
            }
            Ok(())
        };
        let cannot = |error: anyhow::Error| Failure::Input(error.context("writing the file for Foxglove"));
        if self.has_recording {
            let mut recording = Recording::open(&run.file(file::RECORDING)).map_err(Failure::input)?;
            let (mut rising, mut usable, mut first) = (Rising::default(), 0, true);
            for item in recording.by_ref() {
                let (at, item) = item.map_err(Failure::input)?;
                match item {
                    Item::Image(image) => {
                        let at_ns = self.at_ns(image.mid_exposure.seconds_since(self.origin));
                        until(bag, at_ns).map_err(cannot)?;
                        let size_px = [image.width_px, image.height_px];
                        if std::mem::take(&mut first) {
                            self.still(at_ns, Some(size_px), bag).map_err(cannot)?;
                        }
                        if let Some(picture) = picture(&image, at_ns) {
                            bag.write(IMAGE, at_ns, &picture).map_err(cannot)?;
                        }
                        if rising.takes(image.mid_exposure) {
                            self.row(usable, at_ns, bag).map_err(cannot)?;
                            usable += 1;
                        }
                    }
                    Item::Servo(event) => {
                        let at_ns = self.at_ns(at.seconds_since(self.origin));
                        if let Some(message) = telemetry(&event) {
                            until(bag, at_ns).map_err(cannot)?;
                            bag.write(TELEMETRY, at_ns, &message).map_err(cannot)?;
                        }
                    }
                    Item::Command(_) | Item::Gap => {}
                }
            }
            recording.warn_of_shortfall();
        } else {
            let times_s = self.measured.as_ref().map_or_else(Vec::new, |measured| measured.time_s.clone());
            for (row, &time_s) in times_s.iter().enumerate() {
                let at_ns = self.at_ns(time_s);
                until(bag, at_ns).map_err(cannot)?;
                if row == 0 {
                    self.still(at_ns, None, bag).map_err(cannot)?;
                }
                self.row(row, at_ns, bag).map_err(cannot)?;
            }
        }
        until(bag, u64::MAX).map_err(cannot)
    }
}

/// The picture as a message; none where it cannot be read.
fn picture(image: &CameraImage, at_ns: u64) -> Option<Value> {
    Some(match image.encoding {
        Encoding::Jpeg => foxglove::compressed_image(at_ns, "jpeg", &image.data),
        Encoding::Png => foxglove::compressed_image(at_ns, "png", &image.data),
        Encoding::Grey | Encoding::Yuyv => {
            let grey = decode::grey(image).ok()?;
            let mut bytes = Cursor::new(Vec::new());
            let encoder = JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY);
            DynamicImage::ImageLuma8(grey).write_with_encoder(encoder).ok()?;
            foxglove::compressed_image(at_ns, "jpeg", bytes.get_ref())
        }
    })
}

/// What a servo said, where it is a number to plot.
fn telemetry(event: &ServoEvent) -> Option<Value> {
    match *event {
        ServoEvent::Pulse { channel, pulse_us: Some(pulse_us), .. } => {
            Some(json!({ "channel": channel, "pulse_us": pulse_us }))
        }
        ServoEvent::Position { channel, count, .. } => Some(json!({ "channel": channel, "count": count })),
        _ => None,
    }
}
