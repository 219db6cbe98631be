//! The files of a model: the one that is named, and those that it includes.

use std::ffi::OsStr;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::element::Element;
use super::error::Refusals;

/// Names the folders, separated as in `PATH`, that models may include files of beside their own. Whoever starts the program sets
/// it; a model cannot.
pub(super) const FOLDERS_VARIABLE: &str = "RIG_MODEL_FOLDERS";

/// Reads included files, each once.
pub(super) struct Files<'r> {
    /// The model's folder; none where the model is a text without a file.
    folder: Option<PathBuf>,
    /// Further folders that may be read.
    allowed: Vec<PathBuf>,
    read: Vec<PathBuf>,
    refusals: &'r Refusals,
}

impl<'r> Files<'r> {
    /// For a text without a file.
    pub(super) fn none(refusals: &'r Refusals) -> Self {
        Self { folder: None, allowed: Vec::new(), read: Vec::new(), refusals }
    }

    /// For the model at `path`; `allowed`: further folders, separated as in `PATH`.
    pub(super) fn of(path: &Path, allowed: Option<&OsStr>, refusals: &'r Refusals) -> std::io::Result<Self> {
        let path = path.canonicalize()?;
        let allowed = allowed.into_iter().flat_map(std::env::split_paths);
        Ok(Self {
            folder: path.parent().map(Path::to_owned),
            allowed: allowed.filter_map(|folder| folder.canonicalize().ok()).collect(),
            read: vec![path],
            refusals,
        })
    }

    /// Puts the content of the included files in the place of each `<include>` below `root`, the model's own.
    pub(super) fn expand(&mut self, root: &mut Element) {
        let folder = self.folder.clone().unwrap_or_default();
        self.expand_in(root, &folder);
    }

    fn expand_in(&mut self, element: &mut Element, folder: &Path) {
        for mut child in std::mem::take(&mut element.children) {
            if child.tag == "include" {
                element.children.extend(self.include(&child, folder));
            } else {
                self.expand_in(&mut child, folder);
                element.children.push(child);
            }
        }
    }

    /// What an `<include>` in a file of `folder` stands for.
    fn include(&mut self, include: &Element, folder: &Path) -> Vec<Element> {
        let content = self.find(include, folder).and_then(|(path, name)| {
            let text = std::fs::read_to_string(&path).map_err(|error| format!("cannot be read: {error}"))?;
            let mut root = Element::parse(&text, Some(&Arc::from(name)), self.refusals);
            if let Some(root) = &mut root {
                self.expand_in(root, path.parent().unwrap_or(&path));
            }
            Ok(root.map_or_else(Vec::new, |root| root.children))
        });
        content.unwrap_or_else(|problem| {
            let file = include.attribute("file").unwrap_or_default();
            self.refusals.add(&include.place, format!("<include> file=\"{file}\" {problem}"));
            Vec::new()
        })
    }

    /// The included file, and its name as seen from the model's folder; or what is wrong with it.
    fn find(&mut self, include: &Element, folder: &Path) -> Result<(PathBuf, String), String> {
        let Some(own) = &self.folder else {
            return Err("is in no folder, as the model is a text without a file; put in what it holds".into());
        };
        let file = include.attribute("file").filter(|file| !file.is_empty());
        let file = file.ok_or("is needed: the file to read in its place")?;
        // as in MuJoCo: beside the file that includes it, else beside the model
        let mut found = [folder, own].into_iter().filter_map(|folder| folder.join(file).canonicalize().ok());
        let Some(path) = found.next() else {
            return Err(format!("is not there: no {}", folder.join(file).display()));
        };
        if !std::iter::once(own).chain(&self.allowed).any(|folder| path.starts_with(folder)) {
            return Err(format!(
                "leads out of the model's folder, to {}; where that is meant, start the program with {FOLDERS_VARIABLE}={}",
                path.display(),
                path.parent().unwrap_or(&path).display()
            ));
        }
        if self.read.contains(&path) {
            return Err(
                "is read a second time; like MuJoCo, each file once, so that none includes itself".into()
            );
        }
        let name = path.strip_prefix(own).unwrap_or(&path).display().to_string();
        self.read.push(path.clone());
        Ok((path, name))
    }
}
