//! Names that somebody may have meant.

/// Of `known` the names nearest to `wanted`, three at most, nearest first.
pub fn near<'a>(wanted: &str, known: impl IntoIterator<Item = &'a str>) -> Vec<&'a str> {
    let last = |name: &'a str| name.rsplit('.').next().unwrap_or(name);
    let own = wanted.rsplit('.').next().unwrap_or(wanted);
    // A field is often named without the table that it stands in.
    let mut ranked: Vec<(usize, &str)> =
        known.into_iter().map(|name| (distance(wanted, name).min(1 + distance(own, last(name))), name)).collect();
    ranked.sort();
    ranked.into_iter().take(3).map(|(_, name)| name).collect()
}

/// Insertions, deletions and replacements that make `b` of `a` (Levenshtein).
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, from) in a.chars().enumerate() {
        let mut diagonal = std::mem::replace(&mut row[0], i + 1);
        for (j, to) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(from != *to);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(diagonal + 1).min(row[j] + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edits_are_counted() {
        for (a, b, edits) in [("", "abc", 3), ("kitten", "sitting", 3), ("slip", "slip", 0), ("flaw", "lawn", 2)] {
            assert_eq!(distance(a, b), edits, "{a} {b}");
        }
    }

    #[test]
    fn a_field_is_found_without_its_table() {
        let known = ["noise.perception.xy_sigma", "referee.slip", "protocol.hold_time"];
        assert_eq!(near("noise.xy_sgima", known)[0], "noise.perception.xy_sigma");
        assert_eq!(near("protocol.hold_tiem", known)[0], "protocol.hold_time");
    }
}
