//! Frequencies of the ways in which people hold things (`data/people.toml`), and choices of grasps that match them.

use std::path::Path;

use dexterous_grasping::taxonomy::Taxonomy;
use ftac_platform::data::{DataError, parse_toml};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// A way in which people hold things.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct HoldingWay {
    name: String,
    /// Share of the time in which hands are used, %.
    percent: f64,
    /// Names of the types that count as this way.
    types: Vec<String>,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    way: Vec<HoldingWay>,
}

/// Shares of the ways in which people hold things.
#[derive(Debug, Clone)]
pub struct HumanGraspShares {
    ways: Vec<HoldingWay>,
    /// Index of the way of each type.
    way_of: Vec<usize>,
}

/// A way with its shares.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct HoldingWayShare {
    pub name: String,
    /// Share of people's grasps.
    pub people: f64,
    /// Share of the counted grasps.
    pub share: f64,
    pub grasps: usize,
}

impl HumanGraspShares {
    /// Returns the built-in shares.
    ///
    /// # Panics
    /// Never in a tested build: the file is compiled in and a test reads it.
    pub fn builtin(taxonomy: &Taxonomy) -> Self {
        Self::parse(include_str!("../data/people.toml"), Path::new("people.toml"), taxonomy)
            .expect("the built-in shares are valid")
    }

    /// Parses shares. Each type of the `taxonomy` belongs to exactly one way. `path` is used in errors.
    pub fn parse(text: &str, path: &Path, taxonomy: &Taxonomy) -> Result<Self, DataError> {
        let File { way: ways } = parse_toml(text, path)?;
        let fault = |field: String, found: String, expected: &str| DataError::field(path, field, found, expected);
        for (n, way) in ways.iter().enumerate() {
            if let Some(unknown) = way.types.iter().find(|name| taxonomy.find(name).is_none()) {
                return Err(fault(format!("way[{n}].types"), format!("{unknown:?}"), "one of the types' names"));
            }
            if !(way.percent.is_finite() && way.percent > 0.0) {
                return Err(fault(format!("way[{n}].percent"), way.percent.to_string(), "a positive number"));
            }
        }
        let way_of = taxonomy.types.iter().map(|kind| {
            let mut of = (0..ways.len()).filter(|way| ways[*way].types.contains(&kind.name));
            match (of.next(), of.next()) {
                (Some(way), None) => Ok(way),
                _ => Err(fault("way".into(), format!("{:?} in none or several", kind.name), "each type in one")),
            }
        });
        let way_of = way_of.collect::<Result<_, _>>()?;
        Ok(Self { ways, way_of })
    }

    fn share(&self, way: usize) -> f64 {
        self.ways[way].percent / self.ways.iter().map(|way| way.percent).sum::<f64>()
    }

    /// Compares the shares of grasps whose counts by type are `types` with people's shares.
    pub fn compare(&self, types: &[usize]) -> Vec<HoldingWayShare> {
        let all = types.iter().sum::<usize>().max(1) as f64;
        let row = |way: usize| {
            let grasps = types.iter().zip(&self.way_of).filter(|(_, of)| **of == way).map(|(count, _)| count).sum();
            let (name, people) = (self.ways[way].name.clone(), self.share(way));
            HoldingWayShare { name, people, share: grasps as f64 / all, grasps }
        };
        (0..self.ways.len()).map(row).collect()
    }

    /// Chooses at most `most` grasps, as many as possible with people's shares, and returns their numbers. `types`
    /// gives the type index of each grasp. Within a way, the grasps that come first in `order`, a list of grasp
    /// numbers, are taken.
    pub fn choose(&self, types: &[usize], order: &[usize], most: usize) -> Vec<usize> {
        let of = |way: usize| order.iter().copied().filter(move |grasp| self.way_of[types[*grasp]] == way);
        let bound = |way: usize| of(way).count() as f64 / self.share(way);
        let count = (0..self.ways.len()).map(bound).fold(most as f64, f64::min);
        let mut chosen: Vec<usize> =
            (0..self.ways.len()).flat_map(|way| of(way).take((count * self.share(way)).round() as usize)).collect();
        chosen.sort_unstable();
        chosen
    }
}

/// Computes half the sum of the differences between the shares: 0 if they are equal, 1 if they have nothing in common.
pub fn share_distance(ways: &[HoldingWayShare]) -> f64 {
    0.5 * ways.iter().map(|way| (way.people - way.share).abs()).sum::<f64>()
}

/// Formats the shares as a table with a line per way.
pub fn table(ways: &[HoldingWayShare]) -> String {
    let mut text = format!("{:24} {:>8} {:>8} {:>7}\n", "way of people", "people", "here", "grasps");
    for way in ways {
        let [people, share] = [way.people, way.share].map(|share| format!("{:.1} %", 100.0 * share));
        text += &format!("{:24} {people:>8} {share:>8} {:>7}\n", way.name, way.grasps);
    }
    text + &format!("{:24} {:.2}\n", "distance of the shares", share_distance(ways))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Every type belongs to one way, and the shares leave out the ways that are not grasps.
    #[test]
    fn shares_of_people() {
        let taxonomy = Taxonomy::paper();
        let people = HumanGraspShares::builtin(&taxonomy);
        let ways = people.compare(&vec![1; taxonomy.types.len()]);
        assert!((ways.iter().map(|way| way.people).sum::<f64>() - 1.0).abs() < 1e-12);
        assert!((ways[0].people - 31.9 / 81.4).abs() < 1e-3, "{ways:?}");
        assert_eq!(ways.iter().map(|way| way.grasps).sum::<usize>(), 19);
        let twice = include_str!("../data/people.toml").replace("\"Heavy Wrap\"", "\"Heavy Wrap\", \"Pincer\"");
        let error = HumanGraspShares::parse(&twice, Path::new("p.toml"), &taxonomy).expect_err("twice").to_string();
        assert!(error.contains("p.toml") && error.contains("Pincer"), "{error}");
    }

    /// Even if the rarest way bounds the number, the choice has people's shares.
    #[test]
    fn a_choice_has_the_shares() {
        let taxonomy = Taxonomy::paper();
        let people = HumanGraspShares::builtin(&taxonomy);
        // 300 grasps of each type but one of the lumbrical way, of which there are 20.
        let lumbrical = taxonomy.find("Extension Type").expect("a type");
        let count = |kind: usize| match taxonomy.types[kind].name.as_str() {
            "Extension Type" => 20,
            "Parallel Extension" => 0,
            _ => 300,
        };
        let types: Vec<usize> = (0..19).flat_map(|kind| std::iter::repeat_n(kind, count(kind))).collect();
        let order: Vec<usize> = (0..types.len()).collect();
        let chosen = people.choose(&types, &order, 1000);
        let mut counts = vec![0; 19];
        chosen.iter().for_each(|grasp| counts[types[*grasp]] += 1);
        assert_eq!(counts[lumbrical], 20);
        assert!(share_distance(&people.compare(&counts)) < 0.01, "{:?}", people.compare(&counts));
        assert!(share_distance(&people.compare(&[1; 19])) > 0.2);
        assert!(people.choose(&types, &order, 50).len().abs_diff(50) <= 2, "each way is rounded by itself");
    }
}
