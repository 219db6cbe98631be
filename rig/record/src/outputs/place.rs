//! Where a path leads.

use std::os::unix::fs::MetadataExt as _;
use std::path::{Component, Path, PathBuf};

/// Where a path leads, through links and dots, whether or not anything is there yet; and which file is there, whatever else it is called.
#[derive(Debug, Clone)]
pub(super) struct Place {
    /// Absolute, without links and dots.
    pub(super) path: PathBuf,
    /// Device and number of what is there.
    identity: Option<(u64, u64)>,
}

impl Place {
    /// Where `path` leads.
    pub(super) fn of(path: &Path) -> Self {
        let mut place = PathBuf::new();
        for component in std::path::absolute(path).unwrap_or_else(|_| path.into()).components() {
            match component {
                // what comes before has no links any more: up is where its parent is
                Component::ParentDir => drop(place.pop()),
                component => place.push(component),
            }
            if let Ok(there) = place.canonicalize() {
                place = there;
            }
        }
        Self::at(place)
    }

    fn at(path: PathBuf) -> Self {
        let identity = path.metadata().ok().map(|there| (there.dev(), there.ino()));
        Self { path, identity }
    }

    /// Whether both are one file or folder: one path, or one more name for what is there.
    pub(super) fn is(&self, other: &Self) -> bool {
        self.path == other.path || (self.identity.is_some() && self.identity == other.identity)
    }

    /// The way from the folder `folder` to here; empty where this is that folder, none where it does not lie in it.
    pub(super) fn within(&self, folder: &Self) -> Option<PathBuf> {
        let above = self.path.ancestors().find(|above| Self::at((*above).into()).is(folder))?;
        self.path.strip_prefix(above).ok().map(Path::to_owned)
    }
}

#[cfg(test)]
mod tests {
    use std::os::unix::fs::symlink;

    use super::*;

    #[test]
    fn every_spelling_of_a_path_is_one_place_and_other_files_are_others() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir_all(at("a/b")).unwrap();
        std::fs::write(at("a/film"), "film").unwrap();
        std::fs::write(at("a/other"), "film").unwrap();
        std::fs::hard_link(at("a/film"), at("a/b/hard")).unwrap();
        symlink(at("a/film"), at("soft")).unwrap();
        symlink("a/b", at("folder")).unwrap();
        symlink("soft", at("softer")).unwrap();
        let film = Place::of(&at("a/film"));
        for same in [
            "a/./film",
            "a/b/../film",
            "none/../a/film",
            "a/b/hard",
            "soft",
            "softer",
            "folder/../film",
            "folder/hard",
        ] {
            assert!(Place::of(&at(same)).is(&film), "{same}: {:?}", Place::of(&at(same)));
        }
        for other in ["a/other", "a/film2", "film", "a", "folder/film"] {
            assert!(!Place::of(&at(other)).is(&film), "{other}");
        }
        let new = Place::of(&at("folder/new/t.csv"));
        assert_eq!(new.within(&Place::of(&at("a"))), Some("b/new/t.csv".into()));
        assert_eq!(new.within(&Place::of(&at("folder/new"))), Some("t.csv".into()));
        assert_eq!(new.within(&new), Some("".into()));
        assert_eq!(new.within(&film), None);
    }
}
