//! What a balance and a thermometer know about the mechanism, put into the model and the priors of a fit.
//!
//! Video has no scale of force: of weight, buoyancy, inertia and drag only ratios are seen. Weighing every link in
//! air and in water settles them.
//!
//! * A weight in air becomes the body's mass, and its prior where the balance's deviation is known.
//! * A weight in water, with it, says what water the body displaces: its buoyancy, which MJCF holds as `gravcomp`,
//!   displaced over own mass; and the prior of its error, `buoyancy/<body>`, which is a share of it. Without a weight in
//!   water the model's own displaced mass stays, corrected for the density of the water.
//! * Temperature and salinity give the water's density, once anything is weighed.
//!
//! A model of which nothing was weighed stays as it is.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use sim::Model;

use crate::config::{FitConfig, Prior};
use ground::names::did_you_mean;
use ground::strict::{Finite, NonNegative, Positive};

/// The weights of the `[mechanism]` table.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Mechanism {
    /// How it is mounted; not used here.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mount: Option<String>,
    /// Weight in air by body \[kg\].
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub dry_mass_kg: BTreeMap<String, Positive>,
    /// Apparent weight in water by body \[kg\]; negative floats.
    #[serde(skip_serializing_if = "BTreeMap::is_empty")]
    pub wet_mass_kg: BTreeMap<String, Finite>,
    /// Standard deviation of the balance \[kg\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub std_kg: Option<Positive>,
}

/// The `[water]` table.
#[derive(Debug, Clone, Copy, PartialEq, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct Water {
    /// Temperature \[degrees Celsius\].
    #[serde(skip_serializing_if = "Option::is_none")]
    pub temperature_c: Option<Finite>,
    /// Salinity \[g/kg\]; 0 where it is left out.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub salinity_g_per_kg: Option<NonNegative>,
}

/// Why weights cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum WeightError {
    /// The model has no such body.
    #[error("`{table}` names the body `{body}`, which the model does not have{hint}")]
    UnknownBody {
        /// The key of the `[mechanism]` table.
        table: &'static str,
        /// What it says.
        body: String,
        /// The nearest name.
        hint: String,
    },
    /// Heavier in water than in air.
    #[error(
        "body `{body}` weighs {wet_kg} kg in water and {dry_kg} kg in air; water takes weight away, so check `wet_mass_kg`"
    )]
    HeavierInWater {
        /// The body.
        body: String,
        /// In air \[kg\].
        dry_kg: f64,
        /// In water \[kg\].
        wet_kg: f64,
    },
    /// Water that the equation of state does not know.
    #[error(
        "water of {temperature_c} °C and {salinity_g_per_kg} g/kg is outside 0 to 40 °C and 0 to 42 g/kg"
    )]
    Water {
        /// Temperature \[degrees Celsius\].
        temperature_c: f64,
        /// Salinity \[g/kg\].
        salinity_g_per_kg: f64,
    },
}

impl WeightError {
    /// The name at fault, as the `[mechanism]` table spells it.
    pub(crate) fn name(&self) -> &str {
        match self {
            Self::UnknownBody { body, .. } | Self::HeavierInWater { body, .. } => body,
            Self::Water { .. } => "temperature_c",
        }
    }
}

/// Absolute over practical salinity of sea water (35.16504 / 35).
const ABSOLUTE_PER_PRACTICAL: f64 = 1.004_715;
/// Degrees of the scale of 1968 in one of that of 1990.
const SCALE_68_PER_90: f64 = 1.000_24;

impl Water {
    /// Density at atmospheric pressure \[kg/m3\]; `None` where no temperature is stated.
    ///
    /// # Errors
    /// [`WeightError::Water`] outside 0 to 40 °C and 0 to 42 g/kg.
    ///
    /// # Source
    /// F. J. Millero, A. Poisson, "International one-atmosphere equation of state of seawater", Deep-Sea Research
    /// 28A (1981) 625-629; in the form of the UNESCO Technical Papers in Marine Science 44 (1983). Its deviation is
    /// 0.004 kg/m3.
    pub fn density_kg_per_m3(&self) -> Result<Option<f64>, WeightError> {
        let Some(temperature_c) = self.temperature_c.map(Finite::get) else { return Ok(None) };
        let salinity_g_per_kg = self.salinity_g_per_kg.map_or(0.0, NonNegative::get);
        if !(0.0..=40.0).contains(&temperature_c) || salinity_g_per_kg > 42.0 {
            return Err(WeightError::Water { temperature_c, salinity_g_per_kg });
        }
        let (t, s) = (temperature_c * SCALE_68_PER_90, salinity_g_per_kg / ABSOLUTE_PER_PRACTICAL);
        let series = |terms: &[f64]| terms.iter().rev().fold(0.0, |sum, term| sum * t + term);
        let pure = series(&[999.842594, 6.793952e-2, -9.095290e-3, 1.001685e-4, -1.120083e-6, 6.536332e-9]);
        let linear = series(&[0.824493, -4.0899e-3, 7.6438e-5, -8.2467e-7, 5.3875e-9]);
        let root = series(&[-5.72466e-3, 1.0227e-4, -1.6546e-6]);
        Ok(Some(pure + linear * s + root * s.powf(1.5) + 4.8314e-4 * s * s))
    }
}

impl Mechanism {
    /// Whether anything was weighed.
    pub fn is_weighed(&self) -> bool {
        !self.dry_mass_kg.is_empty() || !self.wet_mass_kg.is_empty()
    }

    /// Puts what was weighed into `model`, and into the priors of `fit` where these say nothing themselves.
    ///
    /// # Errors
    /// [`WeightError`], naming the body.
    pub fn put_into(&self, water: &Water, model: &mut Model, fit: &mut FitConfig) -> Result<(), WeightError> {
        let density = water.density_kg_per_m3()?;
        if !self.is_weighed() {
            return Ok(());
        }
        let before = model.settings.density;
        let denser = match density {
            Some(density) if before > 0.0 => density / before,
            _ => 1.0,
        };
        if let Some(density) = density.filter(|_| before > 0.0) {
            model.settings.density = density;
        }
        for (table, body) in self
            .dry_mass_kg
            .keys()
            .map(|body| ("dry_mass_kg", body))
            .chain(self.wet_mass_kg.keys().map(|body| ("wet_mass_kg", body)))
        {
            if !model.bodies.iter().skip(1).any(|known| known.name == *body) {
                let names: Vec<String> =
                    model.bodies.iter().skip(1).map(|known| known.name.clone()).collect();
                let hint = did_you_mean(body, &names);
                return Err(WeightError::UnknownBody { table, body: body.clone(), hint });
            }
        }
        for body in 1..model.bodies.len() {
            let (name, mass) = (model.bodies[body].name.clone(), model.bodies[body].mass);
            let displaced_kg = model.bodies[body].gravity_compensation * mass * denser;
            let dry_kg = self.dry_mass_kg.get(&name).map_or(mass, |dry| dry.get());
            let displaced_kg = match self.wet_mass_kg.get(&name).map(|wet| wet.get()) {
                Some(wet_kg) if wet_kg >= dry_kg => {
                    return Err(WeightError::HeavierInWater { body: name, dry_kg, wet_kg });
                }
                Some(wet_kg) => dry_kg - wet_kg,
                None => displaced_kg,
            };
            model.set(sim::model::Parameter::Mass(body), dry_kg);
            model.bodies[body].gravity_compensation = displaced_kg / dry_kg;
        }
        if let Some(std) = self.std_kg {
            for (body, dry) in &self.dry_mass_kg {
                let name = format!("{body}/mass");
                if let Some(mean) = Finite::new(dry.get()).filter(|_| !fit.fixed.contains(&name)) {
                    fit.prior.entry(name).or_insert(Prior { mean, std });
                }
            }
            for body in self.wet_mass_kg.keys() {
                let name = format!("buoyancy/{body}");
                if let Some(prior) = self.buoyancy(body, std, model).filter(|_| !fit.fixed.contains(&name)) {
                    fit.prior.entry(name).or_insert(prior);
                }
            }
            fit.add_named_causes(model);
        }
        Ok(())
    }
}

impl Mechanism {
    /// What weighing says about the error of the water that `body` of `model` displaces, as a share of it.
    ///
    /// With weights D in air and W in water the body displaces D - W. The model's `gravcomp`, (D - W) / D, follows the mass, so
    /// of the error of D only the share W / D is left to the buoyancy.
    fn buoyancy(&self, body: &str, std_kg: Positive, model: &Model) -> Option<Prior> {
        let known = model.bodies.iter().find(|known| known.name == body)?;
        let follows = known.gravity_compensation;
        let air = if self.dry_mass_kg.contains_key(body) { 1.0 - follows } else { 0.0 };
        let std = Positive::new(std_kg.get() * air.hypot(1.0) / (known.mass * follows))?;
        Some(Prior { mean: Finite::new(0.0)?, std })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn water(temperature_c: f64, practical_salinity: f64) -> Water {
        Water {
            temperature_c: Finite::new(temperature_c / SCALE_68_PER_90),
            salinity_g_per_kg: NonNegative::new(practical_salinity * ABSOLUTE_PER_PRACTICAL),
        }
    }

    #[test]
    fn densities_are_those_that_the_report_prints_to_check_by() {
        for (temperature_c, salinity, wanted) in
            [(5.0, 0.0, 999.96675), (5.0, 35.0, 1027.67547), (25.0, 0.0, 997.04796), (25.0, 35.0, 1023.34306)]
        {
            let density = water(temperature_c, salinity).density_kg_per_m3().unwrap().unwrap();
            assert!((density - wanted).abs() < 1e-4, "{density} {wanted}");
        }
        assert_eq!(Water::default().density_kg_per_m3(), Ok(None));
        assert!(water(60.0, 0.0).density_kg_per_m3().is_err());
    }

    fn weighed(text: &str) -> Result<(Model, FitConfig), WeightError> {
        let mechanism: Mechanism = toml::from_str(text).unwrap();
        let mut model = Model::from_mjcf(include_str!("../tests/data/chain.xml")).unwrap();
        let mut fit = FitConfig::default();
        mechanism.put_into(&water(25.0, 0.0), &mut model, &mut fit).map(|()| (model, fit))
    }

    #[test]
    fn weights_in_air_and_water_become_mass_buoyancy_and_prior() {
        let (model, fit) =
            weighed("dry_mass_kg = { link1 = 0.002 }\nwet_mass_kg = { link1 = 0.0005 }\nstd_kg = 2e-5")
                .unwrap();
        let body = |name: &str| model.bodies.iter().find(|body| body.name == name).unwrap();
        assert_eq!((body("link1").mass, body("link1").gravity_compensation), (0.002, 0.75));
        // Not weighed: 10 x 5 x 30 mm of the stated water.
        let displaced = body("link2").mass * body("link2").gravity_compensation;
        assert!((displaced / (1.5e-6 * 997.04796) - 1.0).abs() < 1e-6, "{displaced}");
        assert!((model.settings.density - 997.04796).abs() < 1e-4);
        assert_eq!(fit.prior["link1/mass"].mean.get(), 0.002);
        // The balance's 0.02 g twice, once by a quarter: of 1.5 g displaced.
        let (mean, std) = (fit.prior["buoyancy/link1"].mean.get(), fit.prior["buoyancy/link1"].std.get());
        assert!(mean == 0.0 && (std / (2e-5 * 0.25_f64.hypot(1.0) / 0.0015) - 1.0).abs() < 1e-9, "{std}");
        assert_eq!(fit.prior.len(), 2);
        assert!(model.parameter_names().contains(&"buoyancy/link1".into()));
    }

    #[test]
    fn a_model_of_which_nothing_was_weighed_stays_as_it_is() {
        let (model, fit) = weighed("std_kg = 2e-5").unwrap();
        assert_eq!(model, Model::from_mjcf(include_str!("../tests/data/chain.xml")).unwrap());
        assert_eq!(fit, FitConfig::default());
    }

    #[test]
    fn impossible_weights_are_refused_with_the_body() {
        let message = |text: &str| weighed(text).unwrap_err().to_string();
        assert!(message("dry_mass_kg = { lnk1 = 0.002 }").contains("did you mean `link1`?"));
        assert!(
            message("dry_mass_kg = { link1 = 1e-3 }\nwet_mass_kg = { link1 = 2e-3 }")
                .contains("`link1` weighs")
        );
    }
}
