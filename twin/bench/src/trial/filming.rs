//! A watcher that keeps all poses for a film.

use anyhow::Result;
use report::film::tactile_map::TactileTiles;
use report::film::{Film, FilmFrame, FilmStage, TRIAL_FRAME_RATE};
use scenarios::record::{Condition, TrialRecord};

use super::{Bench, TickView, Watcher};

/// Conditions that an animation shows side by side.
pub const COMPARED_CONDITIONS: [Condition; 2] = [Condition::Blind, Condition::Touch];

/// Films the branch of one condition on a backend with ground truth.
pub struct Filming {
    condition: Condition,
    /// True if the branch shares no first grasp with the others.
    skips_planned_grasp: bool,
    /// Time between frames, s.
    period: f64,
    /// Tactile images, if the film has them.
    tactile: Option<TactileTiles>,
    /// The film so far.
    pub film: Film,
}

impl Filming {
    /// Films `rate` frames per simulated second of `condition`.
    pub fn new(bench: &Bench, condition: Condition, rate: f64) -> Self {
        let film = Film { title: condition.name().to_owned(), ..Film::default() };
        let skips_planned_grasp = bench.skips_planned_grasp(condition);
        Self { condition, skips_planned_grasp, period: 1.0 / rate, tactile: None, film }
    }

    /// Films `condition` for an animation, which shows the tactile images too.
    pub fn for_animation(bench: &Bench, condition: Condition) -> Self {
        let tactile = Some(TactileTiles::new(bench.world.cell.robot.hand.cameras.len()));
        Self { tactile, ..Self::new(bench, condition, TRIAL_FRAME_RATE) }
    }
}

impl Watcher for Filming {
    fn is_active(&self) -> bool {
        true
    }

    fn on_tick(&mut self, moment: &TickView) -> Result<()> {
        if moment.condition.map_or(self.skips_planned_grasp, |condition| condition != self.condition) {
            return Ok(());
        }
        if let Some(note) = moment.note {
            // Names of objects, for people.
            self.film.notes.push((moment.time, note.replace('_', " ")));
        }
        let due = self.film.frames.last().is_none_or(|last| moment.time - last.time >= self.period - 1e-9);
        if let Some(truth) = moment.truth.filter(|_| due) {
            let inverse = truth.palm.inverse();
            let mut objects = truth.objects.clone();
            if moment.reversed {
                objects.reverse();
            }
            let images = moment.executor.motion().newest_images();
            let tactile = self.tactile.as_mut().map(|tiles| tiles.update(images)).unwrap_or_default();
            self.film.frames.push(FilmFrame {
                time: moment.time,
                phase: moment.executor.phase().to_string(),
                arm: truth.arm_links.clone(),
                palm: truth.palm,
                links: truth.hand_links.iter().map(|link| inverse * link).collect(),
                objects,
                tactile,
            });
        }
        Ok(())
    }

    fn on_branch(&mut self, _: Condition) -> Result<()> {
        Ok(())
    }

    fn on_outcome(&mut self, record: &TrialRecord) -> Result<()> {
        if record.condition == self.condition {
            let contact = if record.contact { ", an unwanted contact" } else { "" };
            let text = match (record.success, record.cause) {
                (true, _) => format!("both objects held{contact}"),
                (false, Some(cause)) => format!("failed: {cause}{contact}"),
                (false, None) => format!("failed{contact}"),
            };
            self.film.outcome = (text, record.clean_success);
        }
        Ok(())
    }
}

/// Returns the constant parts of a film of this combination.
pub fn film_stage(bench: &Bench, combination: usize) -> Result<FilmStage<'_>> {
    let (plan, world) = (&bench.grasp_pairs.pairs[combination], &bench.world);
    let objects = world.models(&plan.objects())?;
    Ok(FilmStage { hand: &world.cell.robot.hand, arm: &world.cell.robot.arm, objects })
}

/// Several watchers of one trial.
pub struct Watchers<'a>(pub Vec<&'a mut dyn Watcher>);

impl Watcher for Watchers<'_> {
    fn is_active(&self) -> bool {
        self.0.iter().any(|one| one.is_active())
    }

    fn on_tick(&mut self, moment: &TickView) -> Result<()> {
        self.0.iter_mut().try_for_each(|one| one.on_tick(moment))
    }

    fn on_branch(&mut self, condition: Condition) -> Result<()> {
        self.0.iter_mut().try_for_each(|one| one.on_branch(condition))
    }

    fn on_outcome(&mut self, record: &TrialRecord) -> Result<()> {
        self.0.iter_mut().try_for_each(|one| one.on_outcome(record))
    }
}
