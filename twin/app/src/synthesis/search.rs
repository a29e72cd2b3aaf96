use std::sync::Arc;
use std::time::Instant;

use anyhow::Result;
use grasping::synthesis::chain::{self, Schedule};
use grasping::synthesis::energy::{GraspEnergy, Weights};
use grasping::synthesis::frames::Frames;
use grasping::synthesis::surface::HandSurface;
use hand_model::Hand;
use rayon::prelude::*;

use super::subject::Subject;
use super::{checks, closing};

pub fn tune(name: &str, n: usize, seed: u64) -> Result<()> {
    let var = |k: &str, d: f64| std::env::var(k).ok().and_then(|v| v.parse().ok()).unwrap_or(d);
    let subject = Subject::named(name)?;
    let hand = Arc::new(Hand::ftac());
    let surface = HandSurface::new(&hand, 2000);
    let d = Weights::default();
    let weights = Weights {
        balance: var("BAL", d.balance),
        rank: var("RANK", d.rank),
        facing: var("FACE", d.facing),
        cable: var("CABLE", d.cable),
        distance: var("DIST", d.distance),
        penetration: var("PEN", d.penetration),
        ..d
    };
    let schedule = Schedule {
        burn_in: var("BURN", 1600.0) as usize,
        steady: var("STEADY", 400.0) as usize,
        hot: var("HOT", 2.0),
        cold: var("COLD", 0.02),
        contact_share: var("SHARE", 0.3),
    };
    let tension = var("TENSION", 20.0);
    let contacts = var("N", 4.0) as usize;
    let energy = GraspEnergy::new(&hand, &surface, &subject.field, weights, None);
    let rows: Vec<_> = (0..n as u64)
        .into_par_iter()
        .map(|k| {
            let mut frames = Frames::new(&hand.tree);
            let t = Instant::now();
            let end = chain::run(&energy, &mut frames, contacts, &schedule, &mut chain::stream(seed, k));
            let t_chain = t.elapsed().as_secs_f64();
            let t = Instant::now();
            let mut sample = end.best.clone();
            if var("ALL", 0.0) > 0.0 {
                sample.contacts = (0..surface.candidates.len()).step_by(10).collect();
            }
            let closed = closing::close(&hand, &surface, &subject, &subject.model, &sample, tension, &mut frames);
            let t_close = t.elapsed().as_secs_f64();
            match closed {
                Ok(closed) => {
                    let t = Instant::now();
                    let margin = checks::margin(&subject, &closed).unwrap();
                    let t_margin = t.elapsed().as_secs_f64();
                    let pen = checks::penetration(&hand, &surface, &subject, &closed);
                    let t = Instant::now();
                    let hold = checks::hold(&closed.scene, &closed.pull);
                    let t_hold = t.elapsed().as_secs_f64();
                    let force: f64 = closed.touches.iter().map(|t| t.force).sum();
                    (t_chain, t_close, t_margin, t_hold, format!("{k} E {:.2} bal {:.2} touches {} F {:.1} moved {:.1} mm {:.0} deg margin {:.2} pen {:.2} mm held {} {:.1} mm {:.0} deg", end.best.terms.total, end.best.terms.balance, closed.touches.len(), force, 1e3 * closed.moved.0, closed.moved.1.to_degrees(), margin, 1e3 * pen, hold.held, 1e3 * hold.distance, hold.angle.to_degrees()), margin >= checks::LEAST_MARGIN, pen <= 1e-3, hold.held, 1)
                }
                Err(e) => (t_chain, t_close, 0.0, 0.0, format!("{k} E {:.2} bal {:.2} {e:?}", end.best.terms.total, end.best.terms.balance), false, false, false, 0),
            }
        })
        .collect();
    if var("ROWS", 0.0) > 0.0 {
        for r in &rows {
            println!("{}", r.4);
        }
    }
    let sum = |f: &dyn Fn(&(f64, f64, f64, f64, String, bool, bool, bool, i32)) -> f64| rows.iter().map(f).sum::<f64>() / rows.len() as f64;
    println!("ms: chain {:.1} close {:.1} margin {:.1} hold {:.1}", 1e3 * sum(&|r| r.0), 1e3 * sum(&|r| r.1), 1e3 * sum(&|r| r.2), 1e3 * sum(&|r| r.3));
    println!("{name} closed {:.3} a {:.3} b {:.3} c {:.3} all {:.3}", sum(&|r| r.8 as f64), sum(&|r| r.5 as i32 as f64), sum(&|r| r.6 as i32 as f64), sum(&|r| r.7 as i32 as f64), sum(&|r| (r.5 && r.6 && r.7) as i32 as f64));
    Ok(())
}
