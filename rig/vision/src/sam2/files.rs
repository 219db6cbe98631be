//! Which files of a folder are a SAM 2 export, by their names.

use std::path::{Path, PathBuf};

use super::error::Sam2Error;

/// The graphs of an export.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Files {
    /// For films.
    Video(VideoFiles),
    /// For single images.
    Image(ImageFiles),
}

/// Four graphs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct VideoFiles {
    pub(super) image_encoder: PathBuf,
    pub(super) image_decoder: PathBuf,
    pub(super) memory_encoder: PathBuf,
    pub(super) memory_attention: PathBuf,
}

/// Two graphs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ImageFiles {
    pub(super) encoder: PathBuf,
    pub(super) decoder: PathBuf,
}

/// The graphs in `folder`: those for films where there are both.
pub(super) fn found(folder: &Path) -> Result<Files, Sam2Error> {
    let missing = |what: String| Sam2Error::Weights { folder: folder.into(), what };
    let entries = std::fs::read_dir(folder).map_err(|error| missing(error.to_string()))?;
    let mut names: Vec<String> = entries
        .filter_map(|entry| entry.ok()?.file_name().into_string().ok())
        .filter(|name| name.to_ascii_lowercase().ends_with(".onnx"))
        .collect();
    names.sort_unstable();
    chosen(&names, folder).map_err(missing)
}

fn chosen(names: &[String], folder: &Path) -> Result<Files, String> {
    let beginning = |start: &str| -> Vec<&String> {
        names.iter().filter(|name| name.to_ascii_lowercase().starts_with(start)).collect()
    };
    let ending = |end: &str| -> Vec<&String> {
        let of_films = |name: &str| name.starts_with("image_") || name.starts_with("memory_");
        names.iter().filter(|name| name.to_ascii_lowercase().ends_with(end) && !of_films(name)).collect()
    };
    let one = |what: &str, found: &[&String]| match found {
        [name] => Ok(folder.join(name)),
        [] if names.is_empty() => Err("holds no graph (*.onnx)".to_owned()),
        [] => Err(format!("holds no {what}, but {}", names.join(", "))),
        [first, second, ..] => Err(format!(
            "holds more than one {what} ({first}, {second}): keep each model in a folder of its own"
        )),
    };
    let (encoder, decoder) = (ending("encoder.onnx"), ending("decoder.onnx"));
    if beginning("memory_").is_empty() && !(encoder.is_empty() && decoder.is_empty()) {
        let files = ImageFiles {
            encoder: one("NAME.encoder.onnx", &encoder)?,
            decoder: one("NAME.decoder.onnx", &decoder)?,
        };
        return Ok(Files::Image(files));
    }
    // The variant that knows the pointers' ages is what SAM 2.1 was trained with.
    let (aged, plain) =
        beginning("memory_attention").into_iter().partition::<Vec<_>, _>(|name| name.contains("objptr"));
    Ok(Files::Video(VideoFiles {
        image_encoder: one("image_encoder.onnx", &beginning("image_encoder"))?,
        image_decoder: one("image_decoder.onnx", &beginning("image_decoder"))?,
        memory_encoder: one("memory_encoder.onnx", &beginning("memory_encoder"))?,
        memory_attention: one("memory_attention.onnx", if aged.is_empty() { &plain } else { &aged })?,
    }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn choose(names: &[&str]) -> Result<Files, String> {
        chosen(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>(), Path::new("w"))
    }

    #[test]
    fn exports_are_told_apart_by_their_names() {
        let image = choose(&["sam2.1_hiera_tiny.decoder.onnx", "sam2.1_hiera_tiny.encoder.onnx"]).unwrap();
        assert!(
            matches!(image, Files::Image(files) if files.encoder.ends_with("sam2.1_hiera_tiny.encoder.onnx"))
        );
        let four =
            ["image_decoder.onnx", "image_encoder.onnx", "memory_attention.onnx", "memory_encoder.onnx"];
        let Files::Video(files) = choose(&four).unwrap() else { panic!("a film's") };
        assert_eq!(files.memory_attention, Path::new("w/memory_attention.onnx"));
        let five: Vec<&str> = [&["memory_attention_objptr.onnx"], &four[..]].concat();
        let Files::Video(files) = choose(&five).unwrap() else { panic!("a film's") };
        assert_eq!(files.memory_attention, Path::new("w/memory_attention_objptr.onnx"));
    }

    #[test]
    fn what_is_missing_or_too_many_is_said() {
        assert_eq!(choose(&[]).unwrap_err(), "holds no graph (*.onnx)");
        let three = ["image_decoder.onnx", "image_encoder.onnx", "memory_encoder.onnx"];
        let told = choose(&three).unwrap_err();
        assert!(told.contains("no memory_attention.onnx, but image_decoder.onnx"), "{told}");
        let told = choose(&["a.decoder.onnx", "a.encoder.onnx", "b.encoder.onnx"]).unwrap_err();
        assert!(told.contains("more than one NAME.encoder.onnx (a.encoder.onnx, b.encoder.onnx)"), "{told}");
    }
}
