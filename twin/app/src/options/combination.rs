//! Numbers of combinations on the command line.

/// Parses the number of a combination.
pub fn combination_number(text: &str) -> Result<usize, String> {
    text.parse().map_err(|_| "expected the number of a combination, from 0".to_owned())
}
