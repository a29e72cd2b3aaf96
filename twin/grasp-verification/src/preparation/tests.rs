use hand_model::RobotModel;
use std::path::Path;

use scenarios::Combination;

use super::*;

/// Returns the benchmark with a cube of `mass` kg and `side` m that only comes second, and a ball that comes first.
fn world(mass: f64, side: f64) -> SimulatedWorld {
    let text = format!(
        r#"
        version = 1
        name = "my things"
        extends = "benchmark"
        first = ["golf_ball", "my_ball"]
        second = ["my_cube", "lemon"]
        [[object]]
        name = "my_ball"
        mass = 0.1
        friction = 0.6
        symmetry = "full"
        shape.sphere.diameter = 0.05
        [[object]]
        name = "my_cube"
        mass = {mass}
        friction = 0.6
        symmetry = "cube"
        shape.box = {{ size = [{side}, {side}, {side}], rounding = 0.001 }}
        "#
    );
    SimulatedWorld::new(&RobotModel::ftac_gen3(), Scenario::parse(&text, Path::new("my.toml")).expect("a scenario"))
        .expect("a world")
}

/// Objects are searched for grasps in the places in which the scenario names them. Those that come with the program are
/// not searched.
#[test]
fn own_objects_are_searched_in_their_places() {
    let world = world(0.1, 0.05);
    let wanted = |builtin: bool| -> Vec<(&str, usize)> {
        searches(&world, builtin).into_iter().map(|search| (search.object.name.as_str(), search.place)).collect()
    };
    assert_eq!(wanted(true), [("my_ball", 0), ("my_cube", 1)]);
    // No grasps exist for a user's own robot.
    assert!(wanted(false).contains(&("golf_ball", 0)) && wanted(false).len() > 2, "{:?}", wanted(false));
}

/// A grasp pair is found again for the same objects and grasps only.
#[test]
fn a_changed_object_or_grasp_is_another_key() {
    let pair = Combination { id: 0, objects: vec!["golf_ball".into(), "my_cube".into()] };
    let mut repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
    let key = |world: &SimulatedWorld, repertoire: &Repertoire| {
        pair_key(world, repertoire, &pair).expect("a key").file_name()
    };
    let first = key(&world(0.1, 0.05), &repertoire);
    assert_eq!(first, key(&world(0.1, 0.05), &repertoire));
    assert_ne!(first, key(&world(0.2, 0.05), &repertoire), "mass");
    assert_ne!(first, key(&world(0.1, 0.052), &repertoire), "size");
    let mut without = world(0.1, 0.05);
    without.scenario.effects = without.scenario.effects.without(Effect::Gel);
    assert_ne!(first, key(&without, &repertoire), "soft pads");
    without.scenario.effects = world(0.1, 0.05).scenario.effects.without(Effect::Detector);
    assert_eq!(first, key(&without, &repertoire), "errors have no part in a rollout");
    repertoire
        .grasps
        .get_mut("golf_ball")
        .expect("grasps")
        .retain(|grasp| grasp.digits == digit_sets(&world(0.1, 0.05))[1]);
    assert_ne!(first, key(&world(0.1, 0.05), &repertoire), "grasps");
}

/// Combinations of the benchmark keep its grasp pairs, also if a scenario adds objects. Other places need other grasp
/// pairs.
#[test]
fn plans_of_the_benchmark_are_used_where_they_fit() {
    let builtin = crate::builtin::grasp_pairs().expect("the built-in plans");
    let plan = &builtin.pairs[7];
    let pair = |first: &str, second: &str| Combination { id: 0, objects: vec![first.into(), second.into()] };
    let mut scenario = world(0.1, 0.05).scenario;
    let known = builtin_pairs(&scenario).expect("plans").expect("the same places");
    let found = known.for_combination(&pair(&plan.first, &plan.second)).flatten().expect("its plan");
    assert_eq!(found.first_grasp, plan.first_grasp);
    assert!(known.for_combination(&pair("golf_ball", "my_cube")).is_none());
    scenario.layout.second.x += 0.01;
    assert!(builtin_pairs(&scenario).expect("plans").is_none());
}

/// An object that cannot be picked up is named, with the number of tries.
#[test]
fn what_cannot_be_picked_is_named() {
    let world = world(0.1, 0.05);
    let cube = world.object("my_cube").expect("the cube");
    let text = describe_found(&GraspSearch { object: &cube, place: 1, digits: digit_sets(&world)[1].clone() }, 0);
    assert!(text.contains("my_cube") && text.contains("50 x 50 x 50 mm") && text.contains("128"), "{text}");
}

/// Returns a grasp pair with placeholder grasp numbers.
fn plan_of(pair: &Combination) -> grasp_pair::GraspPair {
    let mut plan = crate::builtin::grasp_pairs().expect("the built-in plans").pairs.swap_remove(0);
    (plan.first, plan.second) = (pair.objects[0].clone(), pair.objects[1].clone());
    plan
}

/// Returns grasp pairs of the test world's four combinations. Only those for which `works` is true can be done.
fn plans_of(world: &SimulatedWorld, count: usize, works: impl Fn(&Combination) -> bool + Sync) -> GraspPairTable {
    let made = grasp_pair::make_pairs(&world.scenario, count, 1, true, |pair| Ok(works(pair).then(|| plan_of(pair))));
    made.expect("plans")
}

/// Each own object is in a combination as soon as one of its pairs can be done, also if the first ones drawn cannot.
#[test]
fn an_own_object_is_played_instead_of_another_benchmark() {
    let world = world(0.1, 0.05);
    let has =
        |plans: &GraspPairTable, name: &str| plans.pairs.iter().any(|plan| plan.first == name || plan.second == name);
    for count in 1..=4 {
        let plans = plans_of(&world, count, |_| true);
        assert!(plans.pairs.len() == count && has(&plans, "my_ball"), "{count}");
        assert!(count < 2 || has(&plans, "my_cube"));
    }
    // A pair that works is found by the second or third try. A shorter run is the beginning of a longer one.
    let only = |pair: &Combination| pair.objects[0] == "golf_ball";
    let (one, all) = (plans_of(&world, 1, only), plans_of(&world, 4, only));
    assert_eq!((one.pairs[0].second.as_str(), all.pairs[0].second.as_str()), ("my_cube", "my_cube"));
    assert_eq!(all.pairs.len(), 2);
    let mut notes = Vec::new();
    let mut repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
    let any = repertoire.for_digits("golf_ball", &digit_sets(&world)[0]).next().expect("a grasp").clone();
    let cube = repertoire.for_digits("lemon", &digit_sets(&world)[1]).next().expect("a grasp").clone();
    repertoire.insert(Grasp { object: "my_ball".into(), ..any });
    repertoire.insert(Grasp { object: "my_cube".into(), ..cube });
    let left_out = left_out::left_out_objects(&world, &repertoire, &all, 4, &mut notes).expect("the cube is used");
    assert!(left_out.len() == 1 && left_out[0].starts_with("my_ball is not used: none of its 2 pairs"), "{left_out:?}");
    assert!(notes.len() == 1 && notes[0].contains("my_ball + my_cube"), "{notes:?}");
}

/// If none of the user's objects can be picked up or paired, the result is an error with the reasons, not other objects
/// in their place.
#[test]
fn a_scenario_without_its_own_objects_is_refused() {
    let world = world(0.1, 0.05);
    let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
    let error = left_out::refuse_unpickable(&world, &repertoire).expect_err("nothing is known of them");
    let said = error.downcast_ref::<NotPlayable>().expect("the reason").to_string();
    assert!(said.contains("my_ball") && said.contains("my_cube") && said.contains("no grasp was found"), "{said}");
    let without = plans_of(&world, 4, |pair| pair.objects == ["golf_ball", "lemon"]);
    let error =
        left_out::left_out_objects(&world, &repertoire, &without, 4, &mut Vec::new()).expect_err("none of its own");
    assert!(error.is::<NotPlayable>(), "{error}");
}
