//! Links and anchors of a built book.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

/// What the pages of a book say of other places.
#[derive(Debug, Default)]
pub struct Links {
    /// Links that lead somewhere, within the book or to a file of the repository.
    pub sound: usize,
    /// Links to other hosts, which nobody follows here.
    pub elsewhere: BTreeSet<String>,
    /// Page, link, and what is wrong with it.
    pub broken: Vec<String>,
}

/// The values of attribute `name` in `html`, as mdBook writes it: in double quotes.
fn values<'a>(html: &'a str, name: &str) -> impl Iterator<Item = &'a str> {
    let opening = format!(" {name}=\"");
    let length = opening.len();
    let starts: Vec<usize> = html.match_indices(&opening).map(|(at, _)| at + length).collect();
    starts.into_iter().filter_map(move |at| html[at..].split('"').next())
}

/// `path` without `.` and `..`.
fn plain(path: &Path) -> PathBuf {
    path.components().fold(PathBuf::new(), |mut plain, part| {
        match part {
            Component::ParentDir => {
                plain.pop();
            }
            Component::CurDir => {}
            other => plain.push(other),
        }
        plain
    })
}

/// Follows every link of the pages in `built`, a book that will stand at `stands`: what leads out of it leads to a file there.
///
/// # Errors
/// Where a page cannot be read.
pub fn follow(built: &Path, stands: &Path) -> std::io::Result<Links> {
    let stands = &plain(stands);
    let mut pages = BTreeMap::new();
    for entry in std::fs::read_dir(built)? {
        let path = entry?.path();
        let name = path.file_name().and_then(|name| name.to_str()).unwrap_or_default().to_owned();
        // All pages on one, and its frames: anchors are made over there.
        if name.ends_with(".html") && !["print.html", "toc.html", "404.html"].contains(&name.as_str()) {
            pages.insert(name, std::fs::read_to_string(&path)?);
        }
    }
    let anchors: BTreeMap<&str, BTreeSet<&str>> =
        pages.iter().map(|(name, html)| (name.as_str(), values(html, "id").collect())).collect();
    let mut links = Links::default();
    for (name, html) in &pages {
        for link in values(html, "href").chain(values(html, "src")) {
            if link.contains("://") || link.starts_with("mailto:") {
                links.elsewhere.insert(link.to_owned());
                continue;
            }
            if link.starts_with("data:") {
                continue;
            }
            let (file, anchor) = link.split_once('#').unwrap_or((link, ""));
            let target = plain(&stands.join(if file.is_empty() { name } else { file }));
            let complaint = match target.strip_prefix(stands) {
                Ok(inside) if !built.join(inside).exists() => Some("no such page"),
                Ok(inside) => {
                    let known = anchors.get(inside.to_str().unwrap_or_default());
                    let missing = !anchor.is_empty() && known.is_some_and(|known| !known.contains(anchor));
                    missing.then_some("no such heading")
                }
                Err(_) => (!target.exists()).then_some("no such file"),
            };
            match complaint {
                Some(complaint) => links.broken.push(format!("{name}: {link}: {complaint}")),
                None => links.sound += 1,
            }
        }
    }
    Ok(links)
}
