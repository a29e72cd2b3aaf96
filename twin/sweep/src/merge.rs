//! Joins the files of all units: one file per point with sorted rows, and a digest of the result.

use std::fmt::Write as _;
use std::path::PathBuf;

use anyhow::{Context as _, Result};
use ftac_platform::data::write_atomically;
use sha2::{Digest as _, Sha256};

use crate::columns::{TableKind, VERSION, WALL_TIME_COLUMNS};
use crate::folder::SweepFolder;
use crate::plan::{SweepUnit, short_digest};
use crate::table::{ColumnTable, ParquetReader};

/// Result of a merge.
#[derive(Debug, Clone, PartialEq)]
pub struct MergeResult {
    pub units: usize,
    /// Number of unfinished units, which are left out.
    pub missing: usize,
    /// Units with broken files, and the errors. They were moved aside and count as missing.
    pub broken: Vec<(String, String)>,
    /// Number of rows of the trials' table.
    pub trials: usize,
    /// Number of rows of the tries' table.
    pub tries: usize,
    /// Digest of all rows without the names of units and the columns of wall time. The same results have the same
    /// digest, however they were computed.
    pub digest: String,
    /// Total time of the units, s.
    pub core_s: f64,
}

/// Returns the path of a point's file.
pub fn point_path(folder: &SweepFolder, which: TableKind, point: usize) -> PathBuf {
    folder.path.join("merged").join(which.name()).join(format!("point-{point:05}.parquet"))
}

/// Returns the sort keys of rows.
fn sort_keys(which: TableKind) -> &'static [&'static str] {
    match which {
        TableKind::Trials => &["point", "seed", "combination", "trial", "policy", "ablation"],
        TableKind::Tries => &["point", "seed", "combination", "trial", "policy", "try"],
    }
}

/// Joins the finished units.
pub fn merge(folder: &SweepFolder, quiet: bool) -> Result<MergeResult> {
    for which in TableKind::ALL {
        let folder = folder.path.join("merged").join(which.name());
        std::fs::create_dir_all(&folder).with_context(|| folder.display().to_string())?;
    }
    let finished = folder.finished()?;
    let points = folder.plan.points();
    let mut by_point: Vec<Vec<&SweepUnit>> = vec![Vec::new(); points];
    for unit in folder.plan.units.iter().filter(|unit| finished.contains(&unit.id)) {
        by_point[folder.plan.runs[unit.run].point].push(unit);
    }
    let mut merged = MergeResult {
        units: 0,
        missing: 0,
        broken: Vec::new(),
        trials: 0,
        tries: 0,
        digest: String::new(),
        core_s: 0.0,
    };
    let mut digests = TableKind::ALL.map(|_| Sha256::new());
    let mut times = "unit,point,seed,trials,seconds\n".to_owned();
    let bar = progress::bar(points as u64, "points joined", quiet);
    for (point, units) in by_point.iter().enumerate() {
        let mut tables = TableKind::ALL.map(|which| ColumnTable::new(which.columns(&folder.plan.axes)));
        for unit in units {
            match read(folder, unit) {
                Ok((read, seconds)) => {
                    for (table, more) in tables.iter_mut().zip(read) {
                        table.append(more)?;
                    }
                    merged.units += 1;
                    merged.core_s += seconds;
                    let seed = folder.plan.runs[unit.run].request.seed;
                    let _ = writeln!(times, "{},{point},{seed},{},{seconds}", unit.id, unit.count);
                }
                Err(error) => {
                    folder.set_aside(&unit.id)?;
                    merged.broken.push((unit.id.clone(), format!("{error:#}")));
                }
            }
        }
        for ((which, table), digest) in TableKind::ALL.into_iter().zip(&mut tables).zip(&mut digests) {
            table.sort(sort_keys(which))?;
            add(digest, table);
            let metadata = [("ftac.schema", VERSION.to_string()), ("ftac.point", point.to_string())];
            write_atomically(&point_path(folder, which, point), &table.to_parquet(&metadata)?)?;
        }
        merged.trials += tables[0].rows;
        merged.tries += tables[1].rows;
        bar.inc(1);
    }
    bar.finish_and_clear();
    write_atomically(&folder.path.join("merged/units.csv"), times.as_bytes())?;
    merged.missing = folder.plan.units.len() - merged.units;
    let both: Vec<u8> = digests.into_iter().flat_map(Sha256::finalize).collect();
    merged.digest = short_digest(both);
    Ok(merged)
}

/// Reads a unit's tables and its duration, s.
fn read(folder: &SweepFolder, unit: &SweepUnit) -> Result<([ColumnTable; 2], f64)> {
    let open = |which: TableKind| folder.open_checked(which, &unit.id);
    let readers: [ParquetReader; 2] = [open(TableKind::Trials)?, open(TableKind::Tries)?];
    let seconds = readers[0].metadata("ftac.seconds").and_then(|text| text.parse().ok()).unwrap_or(f64::NAN);
    let table = |which: TableKind, reader: &ParquetReader| {
        let path = folder.unit_path(which, &unit.id);
        reader.read(&which.columns(&folder.plan.axes)).with_context(|| path.display().to_string())
    };
    Ok(([table(TableKind::Trials, &readers[0])?, table(TableKind::Tries, &readers[1])?], seconds))
}

/// Adds rows to a digest.
fn add(digest: &mut Sha256, table: &ColumnTable) {
    let counted = |name: &str| name != "unit" && !WALL_TIME_COLUMNS.contains(&name);
    let values: Vec<_> = table
        .columns
        .iter()
        .zip(&table.values)
        .filter(|(column, _)| counted(&column.name))
        .map(|(_, values)| values)
        .collect();
    for row in 0..table.rows {
        for values in &values {
            match values.bytes(row) {
                None => digest.update([0]),
                Some(bytes) => {
                    digest.update([1]);
                    digest.update((bytes.len() as u64).to_le_bytes());
                    digest.update(bytes);
                }
            }
        }
    }
}
