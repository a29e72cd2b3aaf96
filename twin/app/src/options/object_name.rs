//! Names of objects on the command line.

use std::convert::Infallible;

use world::objects::ObjectSet;

/// An object's name as files and tables write it, `salt_mill`, however it was typed: `salt mill`, `Salt-Mill`. A text that is no known name stays
/// as it is, for whoever knows which ones are expected.
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
