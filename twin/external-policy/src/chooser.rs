//! A chooser whose decisions come from an external policy, through its policy server.

use std::sync::Arc;

use control::policy::chooser::{Chooser, ChooserDecision, ChooserError, ChooserSituation};
use hand_model::Hand;
use hand_model::robot::TactileImage;
use serde_json::Value;

use super::message;
use super::server::{PolicyServer, QuestionArray, image_array};

/// Asks a policy server for the decisions.
pub struct ExternalChooser<'a> {
    server: &'a mut dyn PolicyServer,
    hand: &'a Hand,
    /// Images of the untouched pads, one a camera.
    untouched_images: &'a [Arc<TactileImage>],
    /// Question that is asked before the first decision.
    reset_question: Option<Value>,
}

impl<'a> ExternalChooser<'a> {
    /// A chooser for a trial that begins with the question `reset`; `untouched` are the images of the untouched pads.
    pub fn new(
        host: &'a mut dyn PolicyServer,
        hand: &'a Hand,
        untouched: &'a [Arc<TactileImage>],
        reset: Value,
    ) -> Self {
        Self { server: host, hand, untouched_images: untouched, reset_question: Some(reset) }
    }
}

impl Chooser for ExternalChooser<'_> {
    fn choose(&mut self, situation: &ChooserSituation) -> Result<ChooserDecision, ChooserError> {
        if let Some(reset) = self.reset_question.take() {
            self.server.ask(&reset, &[])?;
        }
        let images = situation.images.iter().map(|frame| &frame.image).chain(self.untouched_images);
        let pictures: Vec<QuestionArray> = images.map(image_array).collect();
        Ok(message::parse_choice(self.server.ask(&message::choose_question(self.hand, situation), &pictures)?)?)
    }
}
