use std::path::Path;

use scenarios::Combination;

use super::*;

/// The benchmark with a cube of `mass` kg and `side` m that comes second only, and a ball that comes first.
fn world(mass: f64, side: f64) -> World {
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
    World::new(Scenario::parse(&text, Path::new("my.toml")).expect("a scenario")).expect("a world")
}

/// Objects are searched for grasps in the roles in which the scenario names them; those that come with the program are not.
#[test]
fn own_objects_are_searched_in_their_roles() {
    let world = world(0.1, 0.05);
    let wanted: Vec<(&str, Role)> =
        searches(&world).into_iter().map(|(object, role)| (object.name.as_str(), role)).collect();
    assert_eq!(wanted, [("my_ball", Role::First), ("my_cube", Role::Second)]);
}

/// A plan is found again for the same things and grasps only.
#[test]
fn a_changed_object_or_grasp_is_another_key() {
    let pair = Combination { id: 0, first: "golf_ball".into(), second: "my_cube".into() };
    let mut repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
    let key = |world: &World, repertoire: &Repertoire| pair_key(world, repertoire, &pair).expect("a key").file_name();
    let first = key(&world(0.1, 0.05), &repertoire);
    assert_eq!(first, key(&world(0.1, 0.05), &repertoire));
    assert_ne!(first, key(&world(0.2, 0.05), &repertoire), "mass");
    assert_ne!(first, key(&world(0.1, 0.052), &repertoire), "size");
    let mut without = world(0.1, 0.05);
    without.scenario.effects = without.scenario.effects.without(Effect::Gel);
    assert_ne!(first, key(&without, &repertoire), "soft pads");
    without.scenario.effects = world(0.1, 0.05).scenario.effects.without(Effect::Eyes);
    assert_eq!(first, key(&without, &repertoire), "errors have no part in a rehearsal");
    repertoire.grasps.get_mut("golf_ball").expect("grasps").retain(|grasp| grasp.role == Role::Second);
    assert_ne!(first, key(&world(0.1, 0.05), &repertoire), "grasps");
}

/// Pairs of the benchmark keep its plans, also where a scenario adds objects; places of its own need plans of their own.
#[test]
fn plans_of_the_benchmark_are_used_where_they_fit() {
    let builtin = crate::builtin::plans().expect("the built-in plans");
    let plan = &builtin.plans[7];
    let pair = |first: &str, second: &str| Combination { id: 0, first: first.into(), second: second.into() };
    let mut scenario = world(0.1, 0.05).scenario;
    let known = known_plans(&scenario).expect("plans").expect("the same places");
    let found = known.of(&pair(&plan.first, &plan.second)).flatten().expect("its plan");
    assert_eq!(found.first_grasp, plan.first_grasp);
    assert!(known.of(&pair("golf_ball", "my_cube")).is_none());
    scenario.layout.second.x += 0.01;
    assert!(known_plans(&scenario).expect("plans").is_none());
}

/// What cannot be picked up is named, with what was tried.
#[test]
fn what_cannot_be_picked_is_named() {
    let world = world(0.1, 0.05);
    let cube = world.object("my_cube").expect("the cube");
    let text = found(&cube, Role::Second, 0);
    assert!(text.contains("my_cube") && text.contains("50 x 50 x 50 mm") && text.contains("128"), "{text}");
    let repertoire = crate::builtin::repertoire().expect("the built-in repertoire");
    let text = unpickable(&world, &repertoire);
    assert_eq!(text, "objects without a grasp: first my_ball, second my_cube");
}
