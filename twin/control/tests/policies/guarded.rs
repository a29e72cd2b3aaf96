//! The way to the second object ends where a pad feels what it should not.

use std::sync::Arc;

use control::executive::{Executive, Phase};
use control::guarded::Watch;
use hand_model::pads::IMAGE_SIZE;
use hand_model::robot::{Observation, TactileFrame, TactileImage};

use crate::table::*;

/// Images of all cameras, as bright as `level`; the camera `touched` has a brighter one.
fn images(table: &Table, touched: Option<usize>) -> Vec<TactileFrame> {
    let image = |level: u8| Arc::new(TactileImage { rgb: vec![level; 3 * IMAGE_SIZE * IMAGE_SIZE] });
    let (dark, bright) = (image(100), image(120));
    let of = |camera: usize| if touched == Some(camera) { bright.clone() } else { dark.clone() };
    let frame = |camera| TactileFrame { camera, time: 0.0, sequence: 0, image: of(camera) };
    (0..table.cell.hand.cameras.len()).map(frame).collect()
}

/// The way to the second object with the palm's pads watched, on which a camera's picture changes half-way.
fn with_a_touch_of(camera: Option<usize>) -> Executive {
    let table = Table::new();
    let hand = table.cell.hand.clone();
    let mut executive = table.executive();
    run_until(&mut executive, Phase::Decide);
    executive.decide(table.second()[0].grasp.clone()).expect("a path");
    executive.watch_pads(Watch::new(&hand, |pad| hand.pads[pad].link.is_none()));
    let seen = |executive: &mut Executive, touched| {
        executive.tick(&Observation { tactile: images(&table, touched), ..Observation::default() }).expect("a command");
    };
    while executive.progress() < 0.5 {
        seen(&mut executive, None);
    }
    assert_eq!((executive.phase(), executive.stopped_by()), (Phase::ApproachSecond, None));
    seen(&mut executive, camera);
    executive
}

#[test]
fn what_a_palm_pad_feels_breaks_off_the_try() {
    let hand = hand_model::Hand::ftac();
    let palm = (0..hand.cameras.len()).find(|camera| hand.pads[hand.cameras[*camera].pad].link.is_none());
    let mut executive = with_a_touch_of(palm);
    assert_eq!((executive.stopped_by(), executive.phase()), (palm, Phase::LiftSecond));
    let (low, open) = (executive.palm(), executive.wanted_tensions());
    run_until(&mut executive, Phase::Check);
    let moved = executive.palm().translation.vector - low.translation.vector;
    assert!(moved.z > 0.1 && moved.xy().norm() < 1e-6, "it rises: {moved}");
    assert_eq!(executive.wanted_tensions(), open);
    let (first, second) = (&executive.first().0, &executive.second().0);
    for digit in 0..5 {
        assert_eq!(open[digit], first.close_tension[digit].max(second.pre_tension[digit]), "digit {digit} closes");
    }
}

#[test]
fn what_a_free_digit_feels_does_not() {
    let hand = hand_model::Hand::ftac();
    let index = (0..hand.cameras.len()).find(|camera| hand.pads[hand.cameras[*camera].pad].name == "index_distal");
    let mut executive = with_a_touch_of(index);
    assert!(index.is_some());
    assert_eq!((executive.stopped_by(), executive.phase()), (None, Phase::ApproachSecond));
    run_until(&mut executive, Phase::GraspSecond);
    run_until(&mut executive, Phase::LiftSecond);
}
