//! `ftac grasps hands`: compares several hands on the same objects, by the same search and the same checks: success
//! rates side by side, and one picture of a grasp each.
//!
//! The built-in hand is the first column; others come as URDF with a pulls file. Running the same command again resumes
//! after the last finished hand and object.

use anyhow::{Context, Result, ensure};
use ftac::lab::arguments::grasps::HandsArgs;
use ftac::options::renamed_options;
use ftac::terminal::{CommandOutput, Outcome, Terminal};
use ftac_platform::data::write_atomically;
use grasp_verification::synthesis::hands::{self, ComparedHand, ComparisonCell, HandComparison};
use grasp_verification::synthesis::search;
use grasp_verification::synthesis::synthesizer::SynthesisRequest;
use hand_model::RobotModel;
use indicatif::ProgressStyle;
use lab::study_pages;
use world::objects::ObjectSet;

/// Runs `ftac grasps hands`.
pub fn run(terminal: &Terminal, args: &HandsArgs) -> Outcome {
    renamed_options::note_renamed_options();
    terminal.print_result(make(terminal, args)?)
}

/// Makes the comparison.
pub fn make(terminal: &Terminal, args: &HandsArgs) -> Result<CommandOutput<HandComparison>> {
    let request = search_request(terminal, args)?;
    let hands = compared_hands(args)?;
    let folder = args.out.join("hands");
    std::fs::create_dir_all(&folder).with_context(|| format!("--out {}", folder.display()))?;
    let bar = terminal.progress();
    bar.set_length((hands.len() * args.objects.len()) as u64);
    bar.set_style(ProgressStyle::with_template("{bar:30} {pos}/{len} {msg} [{elapsed} < {eta}]")?);
    let mut cells = Vec::new();
    for hand in &hands {
        for object in &args.objects {
            bar.set_message(progress::printable(&format!("{} on {object}", hand.hand.name())).into_owned());
            cells.push(ComparisonCell::resume(hand, object, &request, &folder)?);
            bar.inc(1);
        }
    }
    bar.finish_and_clear();
    study_pages::hands::write(&hands, &cells, &args.out.join("hands.png"))?;
    let answer = HandComparison::from_cells(&cells);
    write_atomically(&args.out.join("hands.json"), serde_json::to_string_pretty(&answer)?.as_bytes())?;
    let table = hands::table(&hands, &args.objects, &cells);
    let nothing = hands.iter().find(|hand| hands::total(&cells, hand.hand.name()).count == 0);
    Ok(CommandOutput {
        json: answer,
        text: format!("{table}{}/hands.png, hands.json\n", args.out.display()),
        shortfall: nothing.map(|hand| format!("no grasp of {} was verified on any object", hand.hand.name())),
    })
}

/// Returns the search settings, which are the same for every hand and object.
fn search_request(terminal: &Terminal, args: &HandsArgs) -> Result<SynthesisRequest> {
    let contacts = search::parse_contacts(&args.contacts)?;
    let (chains, closings) = (args.n, args.closings);
    ensure!(
        chains > 0 && closings > 0,
        "--n and --closings: found {chains} and {closings}, expected at least 1 of each"
    );
    let (urdfs, pulls) = (args.hand.len(), args.pulls.len());
    ensure!(urdfs == pulls, "--pulls: found {pulls} for {urdfs} --urdf, expected one for each, in the same order");
    let set = ObjectSet::repertoire();
    for (n, name) in args.objects.iter().enumerate() {
        ensure!(set.get(name).is_some(), "--objects: found `{name}`, expected one of {}", set.names().join(", "));
        ensure!(!args.objects[..n].contains(name), "--objects: found `{name}` twice, expected each once");
    }
    Ok(SynthesisRequest { chains, max_grasps: usize::MAX, contacts, closings, seed: terminal.seed, table: false })
}

/// Returns the built-in hand and those of the arguments.
pub fn compared_hands(args: &HandsArgs) -> Result<Vec<ComparedHand>> {
    let mut hands = vec![ComparedHand::from_hand(RobotModel::ftac_gen3().hand)];
    for (urdf, pulls) in args.hand.iter().zip(&args.pulls) {
        let hand = ComparedHand::read(urdf, pulls)?;
        let known = hands.iter().any(|other| other.hand.name() == hand.hand.name());
        ensure!(!known, "--urdf {}: found the name `{}` twice, expected each once", urdf.display(), hand.hand.name());
        hands.push(hand);
    }
    Ok(hands)
}
