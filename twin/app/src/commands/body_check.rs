//! `ftac hand check` and `ftac arm check`.

use std::path::Path;
use std::sync::Arc;

use hand_model::Hand;

use super::Outcome;
use crate::cli::{CheckArgs, Cli};
use crate::{arm_check, check};

/// `ftac arm check`.
pub fn arm_check(cli: &Cli, out: Option<&Path>) -> Outcome {
    let rows = arm_check::run(cli.seed, out, cli.quiet)?;
    show_rows(cli, &rows, out)
}

/// `ftac hand check`, and what its options ask for instead.
pub fn hand_check(cli: &Cli, args: &CheckArgs) -> Outcome {
    let hand = Arc::new(Hand::ftac());
    if let Some(path) = &args.urdf {
        let names: Vec<String> = hand.tree.joints.iter().map(|joint| format!("{}_joint", joint.name)).collect();
        let names: Vec<&str> = names.iter().map(String::as_str).collect();
        let tree = hand_model::urdf::read_tree(path, &names)?;
        eprintln!("{}: {} joints, all of the hand's joints are there", path.display(), tree.len());
        return Ok(None);
    }
    if args.engine {
        let found = check::engine::sweep(&hand)?;
        if cli.json {
            println!("{}", serde_json::json!({ "sweep": found }));
        } else {
            print!("{}", check::engine::table(&found));
        }
        return Ok(None);
    }
    if args.grasps {
        return hand_grasps(cli, args, &hand);
    }
    let options = check::Options { public_model: &args.public_model, out: args.out.as_deref(), seed: cli.seed };
    let rows = check::run(&hand, &options)?;
    show_rows(cli, &rows, args.out.as_deref())
}

fn hand_grasps(cli: &Cli, args: &CheckArgs, hand: &Arc<Hand>) -> Outcome {
    let numbers: Vec<usize> = args.types.iter().map(|number| usize::from(*number)).collect();
    let outcomes = check::feix::run(hand, cli.seed, args.tries as usize, &numbers);
    let text = serde_json::json!({ "seed": cli.seed, "tries": args.tries, "types": outcomes });
    if let Some(folder) = &args.out {
        check::feix::draw(hand, &outcomes, folder)?;
        crate::report::write_whole(&folder.join("grasps.json"), serde_json::to_string_pretty(&text)?.as_bytes())?;
    }
    if cli.json {
        println!("{text}");
    } else {
        print!("{}", check::feix::table(&outcomes));
    }
    let held = outcomes.iter().filter(|outcome| outcome.held).count();
    Ok((held < outcomes.len()).then(|| format!("{held} of {} grasp types are held", outcomes.len())))
}

/// Prints the rows of a check and keeps them in `folder`.
fn show_rows(cli: &Cli, rows: &[check::Row], folder: Option<&Path>) -> Outcome {
    let text = serde_json::json!({ "seed": cli.seed, "rows": rows });
    if let Some(folder) = folder {
        crate::report::write_whole(&folder.join("check.json"), serde_json::to_string_pretty(&text)?.as_bytes())?;
    }
    if cli.json {
        println!("{text}");
    } else {
        print!("{}", check::row::table(rows));
    }
    Ok(check::shortfall(rows))
}
