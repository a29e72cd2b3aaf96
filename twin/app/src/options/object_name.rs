//! Names of objects on the command line.

use std::convert::Infallible;

use world::objects::ObjectSet;

/// Parses an object's name, whatever its case and separators, to the form used in files and tables: `salt mill` and
/// `Salt-Mill` become `salt_mill`. An unknown name is returned unchanged; the caller knows which names are expected.
pub fn object_name(text: &str) -> Result<String, Infallible> {
    let folded = |name: &str| name.trim().to_lowercase().replace([' ', '-'], "_");
    let set = ObjectSet::standard();
    let known = set.names().into_iter().find(|name| folded(name) == folded(text));
    Ok(known.unwrap_or(text).to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_written_one_way() {
        for text in ["salt_mill", "salt mill", "Salt-Mill", " salt mill"] {
            assert_eq!(object_name(text).as_deref(), Ok("salt_mill"));
        }
        assert_eq!(object_name("no such thing").as_deref(), Ok("no such thing"));
    }
}
