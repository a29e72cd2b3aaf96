//! Images of a folder, read once or as they arrive.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Result, bail};
use tactile_optics::calibration::image_files::{is_image, take_background, visible_files};

use crate::video::is_video;

/// Images and videos of a folder, with the image of the untouched gel in it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Inputs {
    /// Files, sorted by name.
    pub files: Vec<PathBuf>,
    /// Image of the untouched gel: the named one, else the folder's image called `background`.
    pub background: Option<PathBuf>,
}

impl Inputs {
    /// Lists the inputs in the folder, or the single image or video, at `path`.
    pub fn find(path: &Path, named: Option<&Path>) -> Result<Self> {
        if path.is_file() {
            return Ok(Self { files: vec![path.to_owned()], background: named.map(Path::to_owned) });
        }
        let mut files = visible_files(path)?;
        files.retain(|file| is_image(file) || is_video(file));
        let background = take_background(&mut files, named)?;
        Ok(Self { files, background })
    }
}

/// Checks that no image's results would overwrite another's: file names without extension must differ.
pub fn check_names(files: &[PathBuf]) -> Result<()> {
    let mut known: BTreeMap<String, &PathBuf> = BTreeMap::new();
    for file in files {
        if let Some(other) = known.insert(image_name(file), file) {
            bail!(
                "{} and {}: found two images of one name; expected names that differ",
                other.display(),
                file.display()
            );
        }
    }
    Ok(())
}

/// Returns an image's file name without its extension.
pub fn image_name(file: &Path) -> String {
    file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Size and modification time of a file.
type Stamp = (u64, Option<SystemTime>);

/// Watcher of a folder into which a camera writes.
#[derive(Debug, Default)]
pub struct FolderWatcher {
    last_stamps: BTreeMap<PathBuf, Stamp>,
    processed: BTreeMap<PathBuf, Stamp>,
}

impl FolderWatcher {
    /// Returns the new or changed images whose size and modification time are unchanged since the last call: a file
    /// that is still being written has to wait.
    pub fn new_files(&mut self, folder: &Path, background: Option<&Path>) -> Result<Vec<PathBuf>> {
        let mut ready = Vec::new();
        for file in Inputs::find(folder, background)?.files {
            let Ok(found) = file.metadata() else { continue };
            let stamp = (found.len(), found.modified().ok());
            let settled = self.last_stamps.insert(file.clone(), stamp) == Some(stamp);
            if settled && self.processed.get(&file) != Some(&stamp) {
                self.processed.insert(file.clone(), stamp);
                ready.push(file);
            }
        }
        Ok(ready)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_image_arrives_once_it_is_written() {
        let folder = tempfile::tempdir().expect("a folder");
        let (file, mut arrivals) = (folder.path().join("a.png"), FolderWatcher::default());
        std::fs::write(folder.path().join("background.png"), b"not one of them").expect("written");
        std::fs::write(&file, b"half").expect("written");
        assert!(arrivals.new_files(folder.path(), None).expect("read").is_empty(), "it may still grow");
        std::fs::write(&file, b"half and half").expect("written");
        assert!(arrivals.new_files(folder.path(), None).expect("read").is_empty(), "it has grown");
        assert_eq!(arrivals.new_files(folder.path(), None).expect("read"), [file]);
        assert!(arrivals.new_files(folder.path(), None).expect("read").is_empty(), "once");
    }

    #[test]
    fn sidecar_files_are_passed_over_and_a_background_may_have_another_name() {
        let folder = tempfile::tempdir().expect("a folder");
        let at = |name: &str| folder.path().join(name);
        for name in [
            "._a.png",
            ".DS_Store",
            "Thumbs.db",
            "a.png",
            "b.BMP",
            "clip.mp4",
            "._clip.mp4",
            "untouched.png",
            "notes.txt",
        ] {
            std::fs::write(at(name), b"").expect("written");
        }
        let found = Inputs::find(folder.path(), Some(&at("untouched.png"))).expect("read");
        assert_eq!(found.files, ["a.png", "b.BMP", "clip.mp4"].map(at));
        assert_eq!(found.background, Some(at("untouched.png")));
        std::fs::rename(at("untouched.png"), at("background.png")).expect("renamed");
        assert_eq!(Inputs::find(folder.path(), None).expect("read").background, Some(at("background.png")));
        std::fs::write(at("background.bmp"), b"").expect("written");
        let error = Inputs::find(folder.path(), None).expect_err("two").to_string();
        assert!(error.contains("2 images of the untouched gel"), "{error}");
    }

    #[test]
    fn two_images_of_one_name_are_refused() {
        let error = check_names(&["x/a.png".into(), "x/a.jpg".into()]).expect_err("one name").to_string();
        assert!(error.contains("a.png") && error.contains("a.jpg"), "{error}");
    }
}
