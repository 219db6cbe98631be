//! The scenes. A new one is a file with a function that changes the setting, and a line in this list.

use crate::optics::scenes::*;
use crate::optics::setting::Setting;
use rand_chacha::ChaCha8Rng;

/// What a scene makes of the plain setting.
pub(crate) type Change = fn(&mut Setting, &mut ChaCha8Rng);

/// Every scene: its name, the change, and the trouble it makes in all images, if any.
pub(crate) const SCENES: &[(&str, Change, Option<&str>)] = &[
    ("clean", |_, _| {}, None),
    ("usual", usual::change, None),
    ("surface", surface::change, Some("surface")),
    ("low-contrast", light_and_colour::low_contrast, Some("low-contrast")),
    ("equal-luma", light_and_colour::equal_luma, Some("equal-luma")),
    ("lit-rim", light_and_colour::lit_rim, Some("lit-rim")),
    ("drift", light_and_colour::drift, Some("drift")),
    ("caustics", light_and_colour::caustics, Some("caustics")),
    ("reflections", reflections::change, Some("reflections")),
    ("bubbles", bubbles::change, None),
    ("hand", hand::change, None),
    ("fish", fish::change, None),
    ("clutter", clutter::change, Some("clutter")),
    ("blur", course::blur, Some("blur")),
    ("rolling", course::rolling, Some("rolling")),
    ("still", course::still, Some("still")),
    ("one-sided", course::one_sided, Some("one-sided")),
    ("two", course::two, None),
    ("ribbon", made::ribbon, Some("ribbon")),
    ("layers", made::layers, Some("layers")),
];

/// Applies the scenes of a name such as `surface+rolling`, in order.
pub(crate) fn apply(name: &str, setting: &mut Setting, rng: &mut ChaCha8Rng) -> Result<(), String> {
    for part in name.split('+') {
        let Some((_, change, trouble)) = SCENES.iter().find(|s| s.0 == part) else {
            let known: Vec<&str> = SCENES.iter().map(|s| s.0).collect();
            return Err(format!("no scene is called {part}; there are {}", known.join(", ")));
        };
        change(setting, rng);
        setting.troubles.extend(trouble);
    }
    Ok(())
}
