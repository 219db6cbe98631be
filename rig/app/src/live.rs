//! What goes on beside the filming: a chronicle of what was told, and extraction and first fit of what was filmed so far.

use std::path::Path;

use super::Watcher;
use super::experiment::Extent;
use analysis::live::Live;
use analysis::showing::Showing;
use analysis::timeline::Chronicle;
use config::RigConfig;
use record::folder::RunFolder;
use run::film::Notice;

/// Hears what is filmed and passes it to whoever looks at it meanwhile.
pub(super) struct Beside<'a> {
    config: &'a RigConfig,
    base: &'a Path,
    extent: Extent,
    /// Worker threads of the extraction.
    threads: usize,
    showing: Showing,
    phase: &'static str,
    /// What was heard since the run began.
    pub(super) chronicle: Option<Chronicle>,
    /// The extraction since the first image.
    pub(super) live: Option<Live>,
}

impl<'a> Beside<'a> {
    /// Beside a run of `config`, whose relative paths start at `base`.
    pub(super) fn new(
        config: &'a RigConfig,
        base: &'a Path,
        extent: Extent,
        threads: usize,
        showing: Showing,
    ) -> Self {
        Self { config, base, extent, threads, showing, phase: "", chronicle: None, live: None }
    }

    /// The next notice of the run in `folder`.
    pub(super) fn hear(&mut self, folder: &RunFolder, notice: Notice, watcher: &mut dyn Watcher) {
        if self.chronicle.is_none() {
            self.chronicle = Some(Chronicle::new(folder.origin()));
            let fps = folder.start().camera.as_ref().map_or(0.0, |camera| camera.fps);
            self.showing.film(&folder.start().id, self.config, folder.origin(), fps);
            let start = || Live::start(folder, self.config, self.base, self.threads, self.showing.clone());
            self.live = (self.extent != Extent::Film).then(start).flatten();
        }
        let (Some(chronicle), live) = (&mut self.chronicle, &mut self.live) else { return };
        match notice {
            Notice::Phase(now, images) => {
                if now != self.phase {
                    watcher.note(&format!("{}  {now}", folder.start().id));
                    self.showing.stage(now, None);
                    self.phase = now;
                }
                watcher.say(format!("{now}: {images} images"));
            }
            Notice::Image(image) => {
                chronicle.image(&image);
                self.showing.image(&image);
                live.iter_mut().for_each(|live| live.image(&image));
            }
            Notice::Servo(event) => {
                chronicle.servo(&event);
                self.showing.servo(&event);
            }
            Notice::Command(command) => {
                chronicle.command(&command);
                self.showing.command(&command);
            }
            Notice::Counted(images, behind) => self.showing.counted(&images, behind),
            Notice::Learn(from) => live.iter_mut().for_each(|live| live.learn(from.clone())),
            Notice::Fit if self.extent != Extent::Report => {}
            Notice::Fit => live.iter_mut().for_each(|live| live.fit(chronicle.clone())),
            Notice::LetGo => watcher.tell("The water is still: let go of the mechanism now."),
            Notice::FallsBehind(behind) => tracing::warn!("{behind}"),
            Notice::Journal(text) => tracing::info!("{text}"),
        }
    }
}
