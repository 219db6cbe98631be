//! The rig that answers make.

use std::path::PathBuf;

use ground::strict::{Finite, NonNegative};
use ident::weights::{Water, WeightError};

use super::answers::{Answers, Shape, YOUR_BOARD, YOUR_CAMERA};
use super::refusal::Refusal;
use camera::Encoding;
use config::{MotionKind, Mount};

/// A chain of equal rigid links in its tank, with its devices; nothing in it contradicts anything else.
#[derive(Debug, Clone, PartialEq)]
pub struct Chain {
    /// The links, from the first pivot to the tip.
    pub links: Vec<Link>,
    /// Length of a link, end to end \[m\].
    pub length_m: f64,
    /// Overlap of two links at their pivot \[m\].
    pub overlap_m: f64,
    /// Width as the camera sees it \[m\].
    pub width_m: f64,
    /// Thickness along the camera's view \[m\].
    pub thickness_m: f64,
    /// Shape of the links.
    pub shape: Shape,
    /// How it is mounted.
    pub mount: Mount,
    /// What moves it.
    pub motion: MotionKind,
    /// The links were weighed; else their density was said.
    pub weighed: bool,
    /// Standard deviation of the balance \[kg\].
    pub balance_std_kg: f64,
    /// Density said or assumed, where nothing was weighed \[kg/m3\].
    pub density_kg_per_m3: f64,
    /// Temperature of the water \[°C\].
    pub water_temperature_c: f64,
    /// Its salinity \[g/kg\].
    pub salinity_g_per_kg: f64,
    /// Its density \[kg/m3\].
    pub water_density_kg_per_m3: f64,
    /// Board and camera.
    pub drive: Drive,
    /// The pictures.
    pub picture: Picture,
}

/// One link.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Link {
    /// Weight in air \[kg\].
    pub dry_kg: f64,
    /// Weight in water \[kg\], where somebody weighed it.
    pub wet_kg: Option<f64>,
    /// Water that it displaces \[kg\].
    pub displaced_kg: f64,
}

/// What board and camera there are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Drive {
    /// Mocks in a simulated tank.
    Mock,
    /// Real ones.
    Real {
        /// Serial port of the board.
        port: String,
        /// The camera.
        device: String,
    },
}

/// The pictures that the camera takes.
#[derive(Debug, Clone, PartialEq)]
pub struct Picture {
    /// How they leave the camera.
    pub format: Encoding,
    /// Width and height \[px\].
    pub size_px: [u32; 2],
    /// Images a second.
    pub fps: f64,
    /// Exposure time \[s\].
    pub exposure_s: f64,
    /// Pixels to metres.
    pub scale: Scale,
}

/// Pixels to metres.
#[derive(Debug, Clone, PartialEq)]
pub enum Scale {
    /// A camera square to the plane of motion.
    Square {
        /// \[m/px\]
        metres_per_pixel: f64,
        /// Where the first pivot is seen, column and row \[px\].
        origin_px: [f64; 2],
        /// Somebody measured it; else the chain fills the picture well.
        measured: bool,
    },
    /// A file by `rig calibrate camera`.
    File(PathBuf),
}

/// Share by which the displaced volume by weights may differ from that of the shape (rounded edges, drilled holes); more is a mistake. Chosen.
const DISPLACED_VOLUME_TOLERANCE_SHARE: f64 = 0.5;
/// Share of the picture's height that the chain fills where the scale was not measured. Chosen.
const DEFAULT_CHAIN_HEIGHT_SHARE: f64 = 2.0 / 3.0;
/// Distance of the first pivot from the edge of the picture, as a share of its height. Chosen.
const FIRST_PIVOT_MARGIN_SHARE: f64 = 0.125;
/// What most prints of PLA have \[kg/m3\]; and a hollow one that floats.
const SINKING_KG_PER_M3: f64 = 1240.0;
const FLOATING_KG_PER_M3: f64 = 900.0;

fn within(
    option: &'static str,
    got: f64,
    [least, most]: [f64; 2],
    unit: &'static str,
) -> Result<f64, Refusal> {
    let fits = (least..=most).contains(&got);
    if fits { Ok(got) } else { Err(Refusal::Range { option, got, least, most, unit }) }
}

/// Plausible lengths \[m\] and weights \[kg\]: a value outside is taken for a wrong unit. Chosen.
const PLAUSIBLE_LENGTHS_M: [f64; 2] = [0.0005, 2.0];
const PLAUSIBLE_WEIGHTS_KG: [f64; 2] = [1e-6, 100.0];

impl Chain {
    /// The rig of these answers.
    ///
    /// # Errors
    /// [`Refusal`].
    pub fn new(answers: &Answers) -> Result<Self, Refusal> {
        let count = answers.links.unwrap_or(3);
        within("links", count as f64, [1.0, 64.0], "links")?;
        let length = |option, said: Option<f64>, default: f64| {
            within(option, said.unwrap_or(default), PLAUSIBLE_LENGTHS_M, "m: metres are asked for")
        };
        let length_m = length("length-m", answers.length_m, 0.03)?;
        let overlap_m = within("overlap-m", answers.overlap_m.unwrap_or(length_m / 6.0), [0.0, 2.0], "m")?;
        if overlap_m >= length_m {
            return Err(Refusal::Overlap { overlap_m, length_m });
        }
        let width_m = length("width-m", answers.width_m, length_m / 3.0)?;
        let thickness_m = length("thickness-m", answers.thickness_m, width_m / 2.0)?;
        let shape = answers.shape.unwrap_or(Shape::Box);
        let mount = answers.mount.unwrap_or(Mount::Hanging);
        let motion = answers.motion.unwrap_or(MotionKind::Driven);
        if (motion, mount) == (MotionKind::Drop, Mount::Horizontal) {
            return Err(Refusal::Motionless);
        }
        let temperature_c = answers.water_temperature_c.unwrap_or(22.0);
        let salinity_g_per_kg = answers.salinity_g_per_kg.unwrap_or(0.0);
        let water_density_kg_per_m3 = water_density(temperature_c, salinity_g_per_kg)?;
        let chain_m = count as f64 * (length_m - overlap_m) + overlap_m;
        let assumed = if mount == Mount::Upright { FLOATING_KG_PER_M3 } else { SINKING_KG_PER_M3 };
        let density = answers.density_kg_per_m3.unwrap_or(assumed);
        let density_kg_per_m3 = within("density-kg-per-m3", density, [1.0, 30_000.0], "kg/m3")?;
        let balance = answers.balance_std_kg.unwrap_or(0.00005);
        let chain = Self {
            links: Vec::new(),
            length_m,
            overlap_m,
            width_m,
            thickness_m,
            shape,
            mount,
            motion,
            weighed: answers.dry_mass_kg.is_some(),
            balance_std_kg: within("balance-std-kg", balance, [1e-9, 1.0], "kg")?,
            density_kg_per_m3,
            water_temperature_c: temperature_c,
            salinity_g_per_kg,
            water_density_kg_per_m3,
            drive: if answers.mock { Drive::Mock } else { real(answers) },
            picture: picture(answers, mount, chain_m)?,
        };
        let links = chain.weights(answers, count)?;
        Ok(Self { links, ..chain })
    }

    /// From one pivot to the next \[m\].
    pub fn pitch_m(&self) -> f64 {
        self.length_m - self.overlap_m
    }

    /// From the last pivot to the tip \[m\].
    pub fn tip_m(&self) -> f64 {
        self.length_m - self.overlap_m / 2.0
    }

    /// End to end \[m\].
    pub fn chain_m(&self) -> f64 {
        self.links.len() as f64 * self.pitch_m() + self.overlap_m
    }

    /// Volume of a link \[m3\].
    fn volume_m3(&self) -> f64 {
        let block = self.length_m * self.width_m * self.thickness_m;
        match self.shape {
            Shape::Box => block,
            Shape::Ellipsoid => block * std::f64::consts::PI / 6.0,
        }
    }

    /// Water in the shape of a link \[kg\].
    pub fn shape_displaces_kg(&self) -> f64 {
        self.volume_m3() * self.water_density_kg_per_m3
    }

    fn weights(&self, answers: &Answers, count: usize) -> Result<Vec<Link>, Refusal> {
        let each = |option: &'static str, said: &Option<Vec<f64>>| match said.as_deref() {
            None => Ok(vec![None; count]),
            Some(&[all]) => Ok(vec![Some(all); count]),
            Some(each) if each.len() == count => Ok(each.iter().copied().map(Some).collect()),
            Some(each) => Err(Refusal::Count { option, got: each.len(), links: count }),
        };
        let (dry, wet) =
            (each("dry-mass-kg", &answers.dry_mass_kg)?, each("wet-mass-kg", &answers.wet_mass_kg)?);
        let section_kg = self.shape_displaces_kg();
        let link = |(index, (dry, wet)): (usize, (Option<f64>, Option<f64>))| {
            let link = index + 1;
            let dry_kg = match (dry, wet) {
                (Some(dry_kg), _) => {
                    within("dry-mass-kg", dry_kg, PLAUSIBLE_WEIGHTS_KG, "kg: kilograms are asked for")?
                }
                (None, Some(_)) => return Err(Refusal::WetAlone),
                (None, None) => self.volume_m3() * self.density_kg_per_m3,
            };
            let displaced_kg = match wet {
                Some(wet_kg) => {
                    within("wet-mass-kg", wet_kg, [-100.0, 100.0], "kg: kilograms are asked for")?;
                    let weighed_kg = dry_kg - wet_kg;
                    if weighed_kg <= 0.0 {
                        return Err(Refusal::HeavierInWater { link, wet_kg, dry_kg });
                    }
                    if (weighed_kg / section_kg - 1.0).abs() > DISPLACED_VOLUME_TOLERANCE_SHARE {
                        return Err(Refusal::Displaced { link, weighed_kg, section_kg });
                    }
                    weighed_kg
                }
                None => section_kg,
            };
            match self.mount {
                Mount::Hanging if dry_kg <= displaced_kg => {
                    Err(Refusal::Floats { link, dry_kg, displaced_kg })
                }
                Mount::Upright if dry_kg >= displaced_kg => {
                    Err(Refusal::Sinks { link, dry_kg, displaced_kg })
                }
                _ => Ok(Link { dry_kg, wet_kg: wet, displaced_kg }),
            }
        };
        dry.into_iter().zip(wet).enumerate().map(link).collect()
    }
}

fn water_density(temperature_c: f64, salinity_g_per_kg: f64) -> Result<f64, Refusal> {
    let unknown = Refusal::Water(WeightError::Water { temperature_c, salinity_g_per_kg });
    let water = Water {
        temperature_c: Finite::new(temperature_c),
        salinity_g_per_kg: NonNegative::new(salinity_g_per_kg),
    };
    if water.salinity_g_per_kg.is_none() {
        return Err(unknown);
    }
    water.density_kg_per_m3()?.ok_or(unknown)
}

fn real(answers: &Answers) -> Drive {
    let said = |said: &Option<String>, placeholder: &str| said.clone().unwrap_or_else(|| placeholder.into());
    Drive::Real { port: said(&answers.port, YOUR_BOARD), device: said(&answers.device, YOUR_CAMERA) }
}

fn picture(answers: &Answers, mount: Mount, chain_m: f64) -> Result<Picture, Refusal> {
    let size_px = answers.size_px.unwrap_or([640, 480]);
    for side in size_px {
        within("size-px", f64::from(side), [64.0, 8192.0], "px")?;
    }
    let fps = within(
        "fps",
        answers.fps.unwrap_or(if answers.mock { 100.0 } else { 60.0 }),
        [1.0, 1000.0],
        "images/s",
    )?;
    let exposure_s =
        within("exposure-s", answers.exposure_s.unwrap_or(0.004_f64.min(0.5 / fps)), [1e-6, 1.0], "s")?;
    if exposure_s * fps > 1.0 {
        return Err(Refusal::Exposure { exposure_s, fps });
    }
    let [width, height] = size_px.map(f64::from);
    let scale = match &answers.calibration {
        Some(file) => Scale::File(file.clone()),
        None => {
            let guess = chain_m / (DEFAULT_CHAIN_HEIGHT_SHARE * height);
            let scale = answers.metres_per_pixel.unwrap_or(guess);
            let metres_per_pixel = within("metres-per-pixel", scale, [1e-6, 0.1], "m")?;
            if chain_m / metres_per_pixel > height {
                let seen_px = chain_m / metres_per_pixel;
                return Err(Refusal::OutOfPicture {
                    metres_per_pixel,
                    chain_m,
                    seen_px,
                    height_px: size_px[1],
                });
            }
            let row = if mount == Mount::Hanging {
                FIRST_PIVOT_MARGIN_SHARE * height
            } else {
                (1.0 - FIRST_PIVOT_MARGIN_SHARE) * height
            };
            Scale::Square {
                metres_per_pixel,
                origin_px: [(width / 2.0).round(), row.round()],
                measured: answers.metres_per_pixel.is_some(),
            }
        }
    };
    // The mock camera takes grey images, and its exposure is its own.
    let format = answers.format.unwrap_or(if answers.mock { Encoding::Grey } else { Encoding::Jpeg });
    Ok(Picture { format, size_px, fps, exposure_s, scale })
}
