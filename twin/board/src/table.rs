//! The table of the board: entries of a folder, in groups of equal work, as text and as Markdown.
//!
//! Rows of a group ran the same trials: seeds, combinations, trials and settings are the same, so their shares can be
//! compared. Rows of different groups cannot.

use std::path::{Path, PathBuf};

use ftac_platform::DataError;
use scenarios::record::Condition;
use schemars::JsonSchema;
use serde::Serialize;

use crate::check::verify;
use crate::entry::{BoardEntry, PolicyKind, SeedUse};
use crate::error::BoardError;
use crate::shares::{Comparison, Share, Shares};

/// Digits of a hash in a table.
const SHORT_HASH: usize = 12;
/// Heads of the columns.
pub const HEADS: [&str; 11] = [
    "name",
    "clean (95 %)",
    "over blind (95 %)",
    "success",
    "contact",
    "time",
    "policy",
    "level",
    "images",
    "seeds",
    "outcomes",
];

/// A row of the board.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct BoardRow {
    /// File of the entry.
    pub file: PathBuf,
    /// Name of the row.
    pub name: String,
    /// Author of the policy.
    pub by: Option<String>,
    /// Page about the policy.
    pub link: Option<String>,
    /// Kind of the policy.
    pub kind: PolicyKind,
    /// Built-in policy, or FILE.py:CLASS.
    pub policy: String,
    /// SHA-256 of the file of a Python policy.
    pub policy_sha256: Option<String>,
    /// Level of its decisions: choose or act.
    pub level: String,
    /// True if it gets tactile images.
    pub sees_images: bool,
    /// Use of the seeds before the run.
    pub seed_use: SeedUse,
    /// Version of the program.
    pub version: String,
    /// Commit of its source tree.
    pub commit: Option<String>,
    /// SHA-256 of the outcomes.
    pub outcomes: String,
    pub shares: Shares,
    /// Paired comparisons of clean success.
    pub comparisons: Vec<Comparison>,
    /// Number of differences of the entry from its own outcomes; 0 for an entry in order.
    pub differences: usize,
}

/// Rows with the same trials.
#[derive(Debug, Clone, PartialEq, Serialize, JsonSchema)]
pub struct BoardGroup {
    pub seeds: Vec<u64>,
    /// Number of combinations.
    pub combinations: usize,
    /// Trials of a combination under one seed.
    pub trials: usize,
    /// Name of the robot model.
    pub robot_model: String,
    /// True if the scenario is the benchmark's.
    pub benchmark: bool,
    /// Differences from a run without options: scale of the noise, effects that are off, robot instance.
    pub changes: Vec<String>,
    /// SHA-256 of the settings.
    pub settings: String,
    /// Rows, the largest clean share first.
    pub rows: Vec<BoardRow>,
}

impl BoardRow {
    fn new(entry: BoardEntry, file: PathBuf, differences: usize) -> Self {
        let facts = entry.policy;
        let policy = match (&facts.file, &facts.class) {
            (Some(file), Some(class)) => format!("{file}:{class}"),
            _ => facts.condition.name().to_owned(),
        };
        Self {
            file,
            name: entry.name,
            by: entry.by,
            link: entry.link,
            kind: facts.kind,
            policy,
            policy_sha256: facts.sha256,
            level: format!("{:?}", facts.level).to_lowercase(),
            sees_images: facts.sees_images,
            seed_use: entry.work.seed_use,
            version: entry.program.version,
            commit: entry.program.commit,
            outcomes: entry.hashes.outcomes,
            shares: entry.shares,
            comparisons: entry.comparisons,
            differences,
        }
    }

    /// Returns the cells of the row, in the order of [`HEADS`].
    pub fn cells(&self) -> [String; 11] {
        let Shares { clean, success, contact, time_ratio, .. } = &self.shares;
        let blind = self.comparisons.iter().find(|comparison| comparison.rival == Condition::Blind);
        [
            self.name.clone() + if self.differences > 0 { " (not in order)" } else { "" },
            with_interval(clean),
            blind.map_or("-".to_owned(), difference_text),
            format!("{:.3}", success.value),
            format!("{:.3}", contact.value),
            time_ratio.map_or("-".to_owned(), |ratio| format!("{ratio:.2}")),
            self.kind.words().to_owned(),
            self.level.clone(),
            if self.sees_images { "yes" } else { "no" }.to_owned(),
            self.seed_use.words().to_owned(),
            short(&self.outcomes).to_owned(),
        ]
    }
}

/// Formats a share with its interval.
pub fn with_interval(share: &Share) -> String {
    format!("{:.3} ({:.3} to {:.3})", share.value, share.low, share.high)
}

/// Formats a difference with its interval, if it has one.
pub fn difference_text(comparison: &Comparison) -> String {
    let value = format!("{:+.3}", comparison.difference);
    match (comparison.low, comparison.high) {
        (Some(low), Some(high)) => format!("{value} ({low:+.3} to {high:+.3})"),
        _ => value,
    }
}

/// Returns the first digits of a hash.
pub fn short(hash: &str) -> &str {
    hash.get(..SHORT_HASH).unwrap_or(hash)
}

impl BoardGroup {
    /// Describes the trials of the group.
    pub fn title(&self) -> String {
        let seeds: Vec<String> = self.seeds.iter().map(u64::to_string).collect();
        let plural = |count: usize, noun: &str| format!("{count} {noun}{}", if count == 1 { "" } else { "s" });
        format!(
            "{} {}, {} x {}, robot {}, {} ({})",
            if self.seeds.len() == 1 { "Seed" } else { "Seeds" },
            seeds.join(", "),
            plural(self.combinations, "combination"),
            plural(self.trials, "trial"),
            self.robot_model,
            [if self.benchmark { "the benchmark's scenario" } else { "another scenario" }]
                .into_iter()
                .chain(self.changes.iter().map(String::as_str))
                .collect::<Vec<_>>()
                .join(", "),
            short(&self.settings)
        )
    }

    fn add(&mut self, row: BoardRow) {
        self.rows.push(row);
        self.rows.sort_by(|a, b| {
            b.shares
                .clean
                .value
                .total_cmp(&a.shares.clean.value)
                .then_with(|| (&a.name, &a.file).cmp(&(&b.name, &b.file)))
        });
    }
}

/// Reads all entries (`*.toml`) of a folder. The group with the most trials is the first.
///
/// # Errors
/// Fails for a folder without entries, and for a file that is no entry.
pub fn read_board(folder: &Path) -> Result<Vec<BoardGroup>, BoardError> {
    if folder.is_file() {
        return Err(BoardError::Option {
            option: "DIR",
            found: format!("the file {}", folder.display()),
            expected: "a folder with entries of `ftac board add`".to_owned(),
        });
    }
    let failed = |source| DataError::Io { path: folder.to_owned(), source };
    let mut files = Vec::new();
    for file in std::fs::read_dir(folder).map_err(failed)? {
        let path = file.map_err(failed)?.path();
        if path.extension().is_some_and(|extension| extension == "toml") {
            files.push(path);
        }
    }
    files.sort();
    if files.is_empty() {
        return Err(BoardError::Option {
            option: "DIR",
            found: format!("no *.toml in {}", folder.display()),
            expected: "entries of `ftac board add`".to_owned(),
        });
    }
    let mut groups: Vec<BoardGroup> = Vec::new();
    for file in files {
        let entry = BoardEntry::read(&file)?;
        let differences = verify(&entry, &file)?.len();
        let group = BoardGroup {
            seeds: entry.work.seeds.clone(),
            combinations: entry.work.combinations,
            trials: entry.work.trials,
            robot_model: entry.settings.robot_model.clone(),
            benchmark: entry.settings.scenario.is_none(),
            changes: entry.settings.changes(),
            settings: entry.hashes.settings.clone(),
            rows: Vec::new(),
        };
        let same = |other: &&mut BoardGroup| BoardGroup { rows: Vec::new(), ..(**other).clone() } == group;
        let row = BoardRow::new(entry, file, differences);
        match groups.iter_mut().find(same) {
            Some(found) => found.add(row),
            None => groups.push(BoardGroup { rows: vec![row], ..group }),
        }
    }
    let size = |group: &BoardGroup| group.seeds.len() * group.combinations * group.trials;
    groups.sort_by(|a, b| size(b).cmp(&size(a)).then_with(|| (&a.seeds, &a.settings).cmp(&(&b.seeds, &b.settings))));
    Ok(groups)
}

/// Note below several groups.
pub const GROUP_NOTE: &str = "Rows of different tables ran other trials and cannot be compared.";

/// Formats the board as text with aligned columns.
pub fn text(groups: &[BoardGroup]) -> String {
    let mut text = String::new();
    for group in groups {
        let mut lines = vec![HEADS.map(|head| head.to_uppercase())];
        lines.extend(group.rows.iter().map(BoardRow::cells));
        let width = |column: usize| lines.iter().map(|line| line[column].chars().count()).max().unwrap_or(0);
        let widths: Vec<usize> = (0..HEADS.len()).map(width).collect();
        text += &format!("{}\n", group.title());
        for line in &lines {
            let cells = line.iter().zip(&widths).map(|(cell, width)| format!("{cell:width$}"));
            text += &format!("  {}\n", cells.collect::<Vec<_>>().join("  ").trim_end());
        }
        text.push('\n');
    }
    if groups.len() > 1 {
        text += &format!("{GROUP_NOTE}\n");
    }
    text
}

/// Formats the board as Markdown, one table a group.
pub fn markdown(groups: &[BoardGroup]) -> String {
    let line = |cells: &[String]| {
        let cells: Vec<String> = cells.iter().map(|cell| cell.replace('\\', "\\\\").replace('|', "\\|")).collect();
        format!("| {} |\n", cells.join(" | "))
    };
    let mut text = String::new();
    for group in groups {
        text += &format!("{}:\n\n", group.title());
        text += &line(&HEADS.map(str::to_owned));
        text += &format!("|{}\n", "---|".repeat(HEADS.len()));
        for row in &group.rows {
            text += &line(&row.cells());
        }
        text.push('\n');
    }
    if groups.len() > 1 {
        text += &format!("{GROUP_NOTE}\n");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::add::tests::touch_entry;

    fn write(folder: &Path, file: &str, change: impl Fn(&mut BoardEntry)) {
        let mut entry = touch_entry();
        change(&mut entry);
        std::fs::write(folder.join(file), entry.to_text().expect("text")).expect("written");
    }

    /// Equal work is one group, sorted by clean share; other seeds or settings are another.
    #[test]
    fn rows_are_grouped_by_work_and_sorted() {
        let folder = tempfile::tempdir().expect("a folder");
        write(folder.path(), "a.toml", |entry| entry.shares.clean.value = 0.1);
        write(folder.path(), "b.toml", |_| {});
        write(folder.path(), "c.toml", |entry| entry.hashes.settings = "0".repeat(64));
        write(folder.path(), "d.toml", |entry| entry.name = "Also | good".to_owned());
        let groups = read_board(folder.path()).expect("a board");
        let names = |group: &BoardGroup| -> Vec<String> {
            group.rows.iter().map(|row| row.file.file_name().expect("a name").to_string_lossy().into_owned()).collect()
        };
        assert_eq!(groups.len(), 2);
        let [other, main] = &groups[..] else { panic!("two groups") };
        assert_eq!(
            (names(other), names(main)),
            (vec!["c.toml".into()], vec!["d.toml".into(), "b.toml".into(), "a.toml".into()])
        );
        // The tampered share is marked, and so is the foreign hash.
        let counts: Vec<usize> = main.rows.iter().map(|row| row.differences).collect();
        assert_eq!((counts, other.rows[0].differences), (vec![0, 0, 1], 1));
        let shown = text(&groups);
        assert!(shown.contains("Touch (not in order)") && shown.ends_with(&format!("{GROUP_NOTE}\n")), "{shown}");
        let starts: Vec<usize> =
            shown.lines().filter_map(|line| line.find("built-in").or_else(|| line.find("POLICY"))).collect();
        assert!(starts.windows(2).filter(|pair| pair[0] == pair[1]).count() >= 4, "{shown}");
        let table = markdown(&groups);
        let row = table.lines().find(|line| line.starts_with("| Also \\| good | 0.917 (")).expect("the row");
        assert!(row.contains(" | built-in | choose | yes | development | "), "{row}");
    }

    #[test]
    fn a_file_that_is_no_entry_is_named() {
        let folder = tempfile::tempdir().expect("a folder");
        let words = || read_board(folder.path()).expect_err("refused").to_string();
        assert!(words().starts_with("DIR: found no *.toml in "));
        std::fs::write(folder.path().join("x.toml"), "schema = 1\n").expect("written");
        assert!(words().contains("x.toml:1: ") && words().contains("missing field `name`"), "{}", words());
    }
}
