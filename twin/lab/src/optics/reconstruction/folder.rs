//! The images of a folder, once or as they come.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::time::SystemTime;

use anyhow::{Context, Result, bail};

/// The images of a folder but for its background, by name; or the one image that `path` is.
pub fn images(path: &Path) -> Result<Vec<PathBuf>> {
    if path.is_file() {
        return Ok(vec![path.to_owned()]);
    }
    let entries = std::fs::read_dir(path).with_context(|| path.display().to_string())?;
    let mut files: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).filter(|file| is_image(file)).collect();
    files.retain(|file| file.file_stem().is_some_and(|stem| stem != "background"));
    files.sort();
    Ok(files)
}

/// The image of the untouched gel in a folder.
pub fn background(folder: &Path) -> Option<PathBuf> {
    ["png", "jpg", "jpeg"]
        .map(|ending| folder.join(format!("background.{ending}")))
        .into_iter()
        .find(|file| file.exists())
}

fn is_image(path: &Path) -> bool {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    ending.is_some_and(|ending| ["png", "jpg", "jpeg"].iter().any(|known| ending == *known))
}

/// Sees to it that no image's results are written over another's: names without their endings must differ.
pub fn check_names(files: &[PathBuf]) -> Result<()> {
    let mut known: BTreeMap<String, &PathBuf> = BTreeMap::new();
    for file in files {
        if let Some(other) = known.insert(name(file), file) {
            bail!(
                "{} and {}: found two images of one name; expected names that differ",
                other.display(),
                file.display()
            );
        }
    }
    Ok(())
}

/// An image's name without its ending.
pub fn name(file: &Path) -> String {
    file.file_stem().map(|stem| stem.to_string_lossy().into_owned()).unwrap_or_default()
}

/// Size and time of a file.
type Stamp = (u64, Option<SystemTime>);

/// A folder into which a camera writes.
#[derive(Debug, Default)]
pub struct Arrivals {
    seen: BTreeMap<PathBuf, Stamp>,
    done: BTreeMap<PathBuf, Stamp>,
}

impl Arrivals {
    /// Images that are new or changed, and whose size and time are what they were at the last call: a file still being written
    /// waits.
    pub fn next(&mut self, folder: &Path) -> Result<Vec<PathBuf>> {
        let mut ready = Vec::new();
        for file in images(folder)? {
            let Ok(found) = file.metadata() else { continue };
            let stamp = (found.len(), found.modified().ok());
            let settled = self.seen.insert(file.clone(), stamp) == Some(stamp);
            if settled && self.done.get(&file) != Some(&stamp) {
                self.done.insert(file.clone(), stamp);
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
        let (file, mut arrivals) = (folder.path().join("a.png"), Arrivals::default());
        std::fs::write(folder.path().join("background.png"), b"not one of them").expect("written");
        std::fs::write(&file, b"half").expect("written");
        assert!(arrivals.next(folder.path()).expect("read").is_empty(), "it may still grow");
        std::fs::write(&file, b"half and half").expect("written");
        assert!(arrivals.next(folder.path()).expect("read").is_empty(), "it has grown");
        assert_eq!(arrivals.next(folder.path()).expect("read"), [file]);
        assert!(arrivals.next(folder.path()).expect("read").is_empty(), "once");
    }

    #[test]
    fn two_images_of_one_name_are_refused() {
        let error = check_names(&["x/a.png".into(), "x/a.jpg".into()]).expect_err("one name").to_string();
        assert!(error.contains("a.png") && error.contains("a.jpg"), "{error}");
    }
}
