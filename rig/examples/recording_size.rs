//! What images take on the disk by several ways to store them without loss, and how many are stored a second on one core.
//!
//! `cargo run --release -p rig --example recording_size -- RECORDING [--noise 3] [--texture 10] [--yuyv]`
//!
//! Takes images from the middle of a recording in grey, best one of a mock tank with `noise_grey = 0`; adds a texture that stays and
//! noise that does not \[standard deviations, grey levels\]; with `--yuyv` in that layout, its chroma half as noisy. The floor is what
//! the noise alone takes: normal noise, rounded, has log2(sigma) + 2.047 bits a sample, of which no way without loss saves anything.

#![expect(clippy::print_stdout, reason = "an example talks to its terminal")]

use std::path::PathBuf;

use anyhow::Context as _;
use camera::{CameraImage, Encoding};
use image::ImageEncoder as _;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use rand_distr::{Distribution, StandardNormal};
use record::filter;
use record::reader::{Item, Recording};
use rustix::time::{ClockId, clock_gettime};

/// Images that are stored.
const IMAGES: usize = 100;
/// Images that a still background is the median of.
const BACKGROUND: usize = 9;

fn main() -> anyhow::Result<()> {
    let (mut path, mut noise, mut texture, mut yuyv) = (None, 0.0, 0.0, false);
    let mut words = std::env::args().skip(1);
    while let Some(word) = words.next() {
        match word.as_str() {
            "--noise" => noise = words.next().context("--noise wants a number")?.parse()?,
            "--texture" => texture = words.next().context("--texture wants a number")?.parse()?,
            "--yuyv" => yuyv = true,
            _ => path = Some(PathBuf::from(word)),
        }
    }
    let images = images(&path.context("name a recording")?, noise, texture, yuyv)?;
    let bytes: usize = images.iter().map(|image| image.data.len()).sum();
    let bits = |sigma: f64| if sigma > 0.0 { (sigma.log2() + 2.047).max(0.0) } else { 0.0 };
    let floor = if yuyv { (bits(noise) + bits(noise / 2.0)) / 16.0 } else { bits(noise) / 8.0 };
    println!("{} images of {} bytes; floor {floor:.3}", images.len(), images[0].data.len());
    println!("{:<36}{:>8}{:>12}{:>10}", "", "share", "images/s", "MB/s");

    let background = background(&images);
    let size = [images[0].width_px, images[0].height_px];
    let mut message = Vec::new();
    type Way<'a> = Box<dyn FnMut(usize) -> anyhow::Result<usize> + 'a>;
    let ways: [(&str, Way<'_>); 10] = [
        ("lz4", Box::new(|n| Ok(lz4_flex::compress(&images[n].data).len()))),
        ("zstd 1", zstd_of(1, |n, out| out.extend(&images[n].data))?),
        ("zstd 3", zstd_of(3, |n, out| out.extend(&images[n].data))?),
        ("qoi, of the grey alone", Box::new(|n| qoi(&images[n], size))),
        ("png, fast", Box::new(|n| png(&images[n], size))),
        (
            "minus the image before, zstd 1",
            zstd_of(1, |n, out| {
                out.extend(difference(&images[n].data, &images[n.saturating_sub(1)].data));
            })?,
        ),
        (
            "minus a median background, zstd 1",
            zstd_of(1, |n, out| {
                out.extend(difference(&images[n].data, &background));
            })?,
        ),
        (
            "minus the byte before, zstd 1",
            zstd_of(1, |n, out| {
                let data = &images[n].data;
                let step = if yuyv { 2 } else { 1 };
                out.extend(&data[..step]);
                out.extend(difference(&data[step..], data));
            })?,
        ),
        (
            "rows above, alone",
            Box::new(|n| {
                message.clear();
                filter::encode(&images[n], &mut message);
                Ok(message.len())
            }),
        ),
        ("rows above, zstd 1: recording.mcap", zstd_of(1, |n, out| filter::encode(&images[n], out))?),
    ];
    for (name, mut way) in ways {
        let begin = processor_s();
        let stored = (0..images.len()).map(&mut way).sum::<anyhow::Result<usize>>()?;
        let took_s = processor_s() - begin;
        println!(
            "{name:<36}{:>8.3}{:>12.0}{:>10.0}",
            stored as f64 / bytes as f64,
            images.len() as f64 / took_s,
            bytes as f64 / took_s * 1e-6
        );
    }
    Ok(())
}

/// Images from the middle of the recording at `path`, made noisy.
fn images(path: &std::path::Path, noise: f64, texture: f64, yuyv: bool) -> anyhow::Result<Vec<CameraImage>> {
    let all: Vec<CameraImage> = Recording::open(path)?
        .filter_map(|item| match item {
            Ok((_, Item::Image(image))) => Some(Ok(image)),
            Ok(_) => None,
            Err(error) => Some(Err(error)),
        })
        .collect::<Result<_, _>>()?;
    let from = all.len() / 2 - (all.len() / 2).min(IMAGES / 2);
    let chosen: Vec<_> = all.into_iter().skip(from).take(IMAGES).collect();
    let first = chosen.first().context("a recording without images")?;
    anyhow::ensure!(
        first.encoding == Encoding::Grey,
        "images are in {:?}; grey ones are wanted",
        first.encoding
    );
    let mut random = ChaCha8Rng::seed_from_u64(1);
    let mut drawn = |sigma: f64| -> f64 {
        let number: f64 = StandardNormal.sample(&mut random);
        sigma * number
    };
    let still: Vec<f64> = first.data.iter().map(|_| drawn(texture)).collect();
    let noisy = |image: CameraImage| {
        let mut data = Vec::new();
        for (grey, still) in image.data.iter().zip(&still) {
            data.push((f64::from(*grey) + still + drawn(noise)).round() as u8);
            if yuyv {
                data.push((128.0 + drawn(noise / 2.0)).round() as u8);
            }
        }
        let encoding = if yuyv { Encoding::Yuyv } else { Encoding::Grey };
        CameraImage { data, encoding, ..image }
    };
    Ok(chosen.into_iter().map(noisy).collect())
}

/// Each byte's median over images spread evenly.
fn background(images: &[CameraImage]) -> Vec<u8> {
    let spread: Vec<_> = images.iter().step_by(images.len().div_ceil(BACKGROUND)).collect();
    let median = |at: usize| {
        let mut values: Vec<u8> = spread.iter().map(|image| image.data[at]).collect();
        values.sort_unstable();
        values[values.len() / 2]
    };
    (0..images[0].data.len()).map(median).collect()
}

fn difference<'a>(bytes: &'a [u8], from: &'a [u8]) -> impl Iterator<Item = u8> + 'a {
    bytes.iter().zip(from).map(|(byte, from)| byte.wrapping_sub(*from))
}

/// zstd at `level` of what `fill` makes of image `n`.
fn zstd_of<'a>(
    level: i32,
    fill: impl Fn(usize, &mut Vec<u8>) + 'a,
) -> anyhow::Result<Box<dyn FnMut(usize) -> anyhow::Result<usize> + 'a>> {
    let mut compressor = zstd::bulk::Compressor::new(level)?;
    let (mut plain, mut packed) = (Vec::new(), Vec::new());
    Ok(Box::new(move |n| {
        plain.clear();
        fill(n, &mut plain);
        packed.resize(zstd::zstd_safe::compress_bound(plain.len()), 0);
        Ok(compressor.compress_to_buffer(&plain, &mut packed[..])?)
    }))
}

/// QOI knows three or four bytes a pixel: grey is given three times.
fn qoi(image: &CameraImage, [width, height]: [u32; 2]) -> anyhow::Result<usize> {
    let grey = image.data.iter().step_by(if image.encoding == Encoding::Yuyv { 2 } else { 1 });
    let rgb: Vec<u8> = grey.flat_map(|&grey| [grey; 3]).collect();
    Ok(qoi::encode_to_vec(rgb, width, height)?.len())
}

fn png(image: &CameraImage, [width, height]: [u32; 2]) -> anyhow::Result<usize> {
    let colour = match image.encoding {
        Encoding::Yuyv => image::ExtendedColorType::La8,
        _ => image::ExtendedColorType::L8,
    };
    let mut file = Vec::with_capacity(image.data.len());
    PngEncoder::new_with_quality(&mut file, CompressionType::Fast, FilterType::Adaptive).write_image(
        &image.data,
        width,
        height,
        colour,
    )?;
    Ok(file.len())
}

fn processor_s() -> f64 {
    let time = clock_gettime(ClockId::ThreadCPUTime);
    time.tv_sec as f64 + time.tv_nsec as f64 * 1e-9
}
