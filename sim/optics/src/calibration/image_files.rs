//! Image files of a folder.
//!
//! Files that other systems leave beside images (`._press_03.png`, `.DS_Store`, `Thumbs.db`) are hidden or not images,
//! and are skipped.

use std::path::{Path, PathBuf};

use crate::error::OpticsError;

/// File name extensions of the images that can be read.
const IMAGE_EXTENSIONS: [&str; 4] = ["png", "jpg", "jpeg", "bmp"];
/// Readable formats, for messages.
pub const IMAGE_FORMATS: &str = "PNG, JPEG or BMP";
/// Name of the untouched gel's image, without its extension.
pub const BACKGROUND_NAME: &str = "background";

/// True if a file is an image by its name, and not hidden.
pub fn is_image(path: &Path) -> bool {
    let ending = path.extension().map(|ending| ending.to_ascii_lowercase());
    !is_hidden(path) && ending.is_some_and(|ending| IMAGE_EXTENSIONS.iter().any(|known| ending == *known))
}

/// True if a file's name begins with a dot.
pub fn is_hidden(path: &Path) -> bool {
    path.file_name().is_some_and(|name| name.to_string_lossy().starts_with('.'))
}

/// Lists the files of a folder that are not hidden, sorted by name.
pub fn visible_files(folder: &Path) -> Result<Vec<PathBuf>, OpticsError> {
    let entries = std::fs::read_dir(folder).map_err(|error| OpticsError::file(folder, error))?;
    let files = entries.flatten().map(|entry| entry.path()).filter(|path| path.is_file() && !is_hidden(path));
    let mut files: Vec<PathBuf> = files.collect();
    files.sort();
    Ok(files)
}

/// Lists the images of a folder, sorted by name.
pub fn list_images(folder: &Path) -> Result<Vec<PathBuf>, OpticsError> {
    let mut files = visible_files(folder)?;
    files.retain(|path| is_image(path));
    Ok(files)
}

/// Removes the untouched gel's image from the images of a folder and returns it: the one called `named`, else
/// `background`. Returns an error if there are several.
pub fn take_background(files: &mut Vec<PathBuf>, named: Option<&Path>) -> Result<Option<PathBuf>, OpticsError> {
    if let Some(named) = named {
        let same = |file: &Path| match (file.canonicalize(), named.canonicalize()) {
            (Ok(file), Ok(named)) => file == named,
            _ => file == named,
        };
        files.retain(|file| !same(file));
        return Ok(Some(named.to_owned()));
    }
    let is_background = |file: &Path| file.file_stem().is_some_and(|stem| stem.eq_ignore_ascii_case(BACKGROUND_NAME));
    let (found, others): (Vec<_>, Vec<_>) = files.drain(..).partition(|file| is_background(file));
    *files = others;
    if let [_, second, ..] = found.as_slice() {
        let what = format!("found {} images of the untouched gel; expected one, or --background FILE", found.len());
        return Err(OpticsError::file(second, what));
    }
    Ok(found.into_iter().next())
}
