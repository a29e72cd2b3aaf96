//! Tests: depth in the engine against depth in the image, shear against its law, and holds at rest.

use hand_model::pads::PadCamera;
use tactile_optics::press;
use world::Symmetry;

use super::*;
use crate::body::cover_collider;
use crate::engine::{Engine, EngineSettings};

const GEL: GelViscoelasticity = GelViscoelasticity { relaxation: 0.03, shear: 0.5 };
const FORCES: [f64; 3] = [0.5, 2.0, 8.0];

fn model(shape: ObjectShape) -> Arc<ObjectModel> {
    Arc::new(ObjectModel {
        name: "thing".into(),
        shape,
        mass: 0.2,
        friction: 0.8,
        color: [0; 3],
        rest: nalgebra::UnitQuaternion::identity(),
        symmetry: Symmetry::None,
    })
}

/// A sphere, a lying cylinder and a box, with their rotations above a pad.
fn shapes() -> [(&'static str, ObjectShape, Vector3<f64>); 3] {
    let half = Vector3::new(0.025, 0.022, 0.02);
    [
        ("ball", ObjectShape::Sphere { radius: 0.03 }, Vector3::zeros()),
        (
            "cylinder",
            ObjectShape::Cylinder { radius: 0.02, half_height: 0.04 },
            Vector3::x() * std::f64::consts::FRAC_PI_2,
        ),
        ("box", ObjectShape::Cuboid { half, radius: 0.002 }, Vector3::zeros()),
    ]
}

/// An object pressed onto the middle of a pad of a fixed link.
struct Bed {
    hand: Hand,
    pad: usize,
    engine: Engine,
    body: RigidBodyHandle,
    model: Arc<ObjectModel>,
}

impl Bed {
    fn new(pad: &str, shape: &ObjectShape, turn: &Vector3<f64>, gel: Option<GelViscoelasticity>) -> Self {
        let hand = Hand::ftac();
        let pad = hand.find_pad(pad).expect("a pad");
        let mut engine = Engine::new(EngineSettings::default());
        engine.gravity = Vector::ZERO;
        let cover = hand.pads[pad].link.map_or(hand.palm_cover, |link| hand.covers[link]);
        let link = engine.bodies.insert(RigidBodyBuilder::fixed());
        let soft = engine.colliders.insert_with_parent(cover_collider(&cover), link, &mut engine.bodies);
        let model = model(shape.clone());
        let rotation = nalgebra::UnitQuaternion::from_scaled_axis(*turn);
        let lowest = -model
            .shape
            .support(&(rotation.inverse() * -Vector3::z()))
            .coords
            .dot(&(rotation.inverse() * -Vector3::z()));
        let place = hand.pads[pad].link_from_pad
            * Isometry3::from_parts(Vector3::new(0.0, 0.0, 1e-4 - lowest).into(), rotation);
        let placement = crate::scene::ObjectPlacement { model: model.clone(), pose: place };
        let (_, body, collider) = crate::scene::insert_object(&mut engine, &placement);
        engine.bodies[body].lock_rotations(true, true);
        engine.soft_covers = gel.map(|gel| {
            let covers = std::iter::once((soft, hand.pads[pad].link));
            SoftCovers::new(&hand, &gel, covers, std::iter::once((collider, model.clone())), &mut engine.colliders)
        });
        Self { hand, pad, engine, body, model }
    }

    /// Presses for `seconds` with a `force` (N, pad frame).
    fn press(&mut self, force: Vector3<f64>, seconds: f64) {
        let world = convert::vector(&(self.hand.pads[self.pad].link_from_pad * force));
        let body = &mut self.engine.bodies[self.body];
        body.reset_forces(true);
        body.add_force(world, true);
        for _ in 0..(seconds / self.engine.settings.dt).round() as usize {
            self.engine.step();
        }
    }

    fn pad_from_object(&self) -> Isometry3<f64> {
        self.hand.pads[self.pad].link_from_pad.inverse() * convert::to_pose(self.engine.bodies[self.body].position())
    }

    /// Returns the height of the object's lowest point above a position on the pad, m.
    fn lowest(&self) -> impl Fn(f64, f64) -> Option<f64> {
        let (object_from_pad, shape) = (self.pad_from_object().inverse(), self.model.shape.clone());
        move |x, y| {
            let origin = object_from_pad * Point3::new(x, y, -0.006);
            shape.ray(&origin, &Unit::new_unchecked(object_from_pad * Vector3::z())).map(|far| far - 0.006)
        }
    }

    /// Returns the object's penetration of the pad in the engine, and in its image under `force` (N), m.
    fn depths(&self, force: f64) -> [f64; 2] {
        let pad = &self.hand.pads[self.pad];
        let cameras: Vec<&PadCamera> = pad.cameras.iter().map(|camera| &self.hand.cameras[*camera]).collect();
        let pressed = press(pad, &cameras, &self.hand.gel(), force, self.lowest()).expect("pressed");
        let image = pressed.maps.iter().map(|map| f64::from(map.max_depth())).fold(0.0, f64::max);
        // The image shifts the object before it reaches that depth.
        [image - pressed.shift, image]
    }
}

/// Depth in the engine equals depth in the image at the same force.
#[test]
fn the_engine_s_depth_is_the_image_s() {
    let mut worst = 0.0f64;
    for pad in ["index_distal", "middle_proximal", "palm_ulnar"] {
        for (name, shape, turn) in shapes() {
            for force in FORCES {
                let mut bed = Bed::new(pad, &shape, &turn, Some(GEL));
                bed.press(Vector3::new(0.0, 0.0, -force), 1.0);
                let [engine, image] = bed.depths(force);
                println!("{pad} {name} {force} N: engine {:.3} mm, image {:.3} mm", 1e3 * engine, 1e3 * image);
                worst = worst.max((engine - image).abs() - 0.02 * image);
            }
        }
    }
    assert!(worst < 1e-5, "{worst} m beyond 2 %");
}

/// The gel follows a force step with its relaxation time: after one time constant it has covered 63 % of the change.
#[test]
fn the_gel_takes_its_time() {
    let ball = ObjectShape::Sphere { radius: 0.03 };
    let mut bed =
        Bed::new("index_distal", &ball, &Vector3::zeros(), Some(GelViscoelasticity { relaxation: 0.2, ..GEL }));
    let depth = |bed: &Bed| -bed.pad_from_object().translation.vector.z + 0.03;
    bed.press(Vector3::new(0.0, 0.0, -0.5), 3.0);
    let before = depth(&bed);
    bed.press(Vector3::new(0.0, 0.0, -2.0), 0.2);
    let on_the_way = depth(&bed) - before;
    bed.press(Vector3::new(0.0, 0.0, -2.0), 3.0);
    let whole = depth(&bed) - before;
    let share = on_the_way / whole;
    assert!((share - 0.632).abs() < 0.05, "{share} of {whole} m");
}

/// Under a tangential load within its friction, the surface moves by `shear` times the proportional share of its depth,
/// and the object does not slip.
#[test]
fn shear_follows_its_law() {
    let ball = ObjectShape::Sphere { radius: 0.03 };
    let mut bed = Bed::new("palm_ulnar", &ball, &Vector3::zeros(), Some(GEL));
    bed.press(Vector3::new(0.0, 0.0, -2.0), 1.0);
    let before = bed.pad_from_object().translation.vector;
    let (normal, along) = (2.0, 0.8);
    bed.press(Vector3::new(along, 0.0, -normal), 5.0);
    let moved = bed.pad_from_object().translation.vector - before;
    assert!(moved.norm() < 2e-4, "slipped by {moved}");
    let give = bed.engine.soft_covers.as_ref().and_then(|covers| covers.cover_response(0, 0)).expect("a contact");
    let shear = bed.hand.pads[bed.pad].link_from_pad.inverse_transform_vector(&give.shear);
    let expected = GEL.shear * give.penetration * along / normal;
    assert!((shear - Vector3::new(expected, 0.0, 0.0)).norm() < 0.05 * expected, "{shear} {expected}");
}

/// Nothing moves in the last seconds of a press, and a branch continues bit-exactly.
#[test]
fn a_press_rests_and_branches() {
    for (name, shape, turn) in shapes() {
        for force in FORCES {
            let mut bed = Bed::new("middle_proximal", &shape, &turn, Some(GEL));
            bed.press(Vector3::new(0.0, 0.2 * force, -force), 1.0);
            let branch = bed.engine.clone();
            let before = bed.pad_from_object().translation.vector;
            let mut farthest = 0.0f64;
            for _ in 0..50 {
                bed.press(Vector3::new(0.0, 0.2 * force, -force), 0.1);
                farthest = farthest.max((bed.pad_from_object().translation.vector - before).norm());
            }
            let after = bed.engine.bodies[bed.body].translation();
            bed.engine = branch;
            bed.press(Vector3::new(0.0, 0.2 * force, -force), 5.0);
            assert_eq!(after, bed.engine.bodies[bed.body].translation(), "{name}");
            let mut rigid = Bed::new("middle_proximal", &shape, &turn, None);
            rigid.press(Vector3::new(0.0, 0.2 * force, -force), 1.0);
            let start = rigid.pad_from_object().translation.vector;
            rigid.press(Vector3::new(0.0, 0.2 * force, -force), 5.0);
            let crept = (rigid.pad_from_object().translation.vector - start).norm();
            println!(
                "{name} {force} N: moves by {:.4} mm in 5 s, {:.4} mm on rigid covers",
                1e3 * farthest,
                1e3 * crept
            );
            assert!(farthest < crept + 2e-5, "{name} {force}: {farthest}, {crept} on rigid covers");
        }
    }
}

/// Against a rigid object the force responds to the penetration thirty times as sharply as the gel. With the full
/// relaxation fraction the contact oscillates for ever; with the damped one it comes to rest.
#[test]
fn a_contact_with_a_fastened_object_comes_to_rest() {
    let (gel, wall, share, deep) = (1.8e3, 6e4, 0.13, 1e-3);
    let way = |sink: f64| wall * (deep - sink).max(0.0) / gel - sink;
    let fresh = GelContact {
        cover: 0,
        object: 0,
        penetration: 0.0,
        load: CoverLoad::default(),
        curve: None,
        age: 0,
        last: (MIN_RELAXATION_SHARE * share, 0.0),
    };
    let (mut plain, mut contact) = (0.0, fresh);
    for _ in 0..200 {
        plain += share * way(plain);
        let off = way(contact.penetration);
        contact.penetration += contact.relaxation_share(off, share) * off;
    }
    let rest = deep * wall / (wall + gel);
    assert!((contact.penetration - rest).abs() < 1e-5, "{} {rest}", contact.penetration);
    assert!((plain - rest).abs() > 1e-5 || way(plain).abs() > 1e-4, "{plain}");
}
