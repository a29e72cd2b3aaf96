//! Suggestions for misspelled names.

use strsim::levenshtein;

/// Returns the names of `known` nearest to `wanted`, at most three, nearest first.
pub fn nearest_names<'a>(wanted: &str, known: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    let last = |name: &'a str| name.rsplit('.').next().unwrap_or(name);
    let own = wanted.rsplit('.').next().unwrap_or(wanted);
    // A field is often named without its table.
    let mut ranked: Vec<(usize, &str)> =
        known.into_iter().map(|name| (levenshtein(wanted, name).min(1 + levenshtein(own, last(name))), name)).collect();
    ranked.sort();
    ranked.into_iter().take(3).map(|(_, name)| name).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_field_is_found_without_its_table() {
        let known = ["noise.perception.xy_sigma", "referee.slip", "protocol.hold_time"];
        assert_eq!(nearest_names("noise.xy_sgima", known)[0], "noise.perception.xy_sigma");
        assert_eq!(nearest_names("protocol.hold_tiem", known)[0], "protocol.hold_time");
    }
}
