use anyhow::Result;
use bench::builtin::make_bench;
use bench::trial::NoWatcher;
use rayon::prelude::*;
use scenarios::record::Condition;
use scenarios::Scenario;

fn main() -> Result<()> {
    let args: Vec<usize> = std::env::args().skip(1).map(|a| a.parse().unwrap()).collect();
    let bench = make_bench(Scenario::benchmark(), args[0], 1, true)?;
    let jobs: Vec<(usize, usize)> = (args[1]..args[2]).flat_map(|t| (0..args[0]).map(move |c| (c, t))).collect();
    let conditions: &[Condition] = if args.get(3) == Some(&1) { &[Condition::Blind, Condition::Touch] } else { &[Condition::Touch] };
    jobs.par_iter().with_max_len(1).try_for_each(|(c, t)| {
        let r = bench.trial(*c, *t, conditions, &[], &mut NoWatcher)?;
        println!("{}", serde_json::json!({"records": r.records, "tries": r.tries}));
        Ok(())
    })
}
