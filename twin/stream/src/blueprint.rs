//! The layout of the viewer; it is stored in every recording.
//!
//! Left: the world, large, over plots that share a time axis. Right: tactile images and height maps as two pictures of the
//! opened hand, over the phases and the log.
//!
//! Rerun's own builder cannot set a camera, hide a legend or link axes. Those are properties of a view like any other, logged
//! below its path in the blueprint; [`send`] adds them to what the builder makes.

use rerun::blueprint::{
    Blueprint, BlueprintActivation, BlueprintPanel, ContainerLike, Horizontal, SelectionPanel, Spatial2DView,
    Spatial3DView, StateTimelineView, Tabs, TextDocumentView, TextLogView, TimePanel, TimeSeriesView, Vertical,
    components::PanelState,
};
use rerun::external::re_log_types::BlueprintActivationCommand;
use rerun::external::re_sdk_types::blueprint::archetypes::{
    Background, EyeControls3D, LineGrid3D, PlotLegend, TimeAxis, VisualBounds2D,
};
use rerun::external::re_sdk_types::blueprint::components::{BackgroundKind, Corner2D, LinkAxis};
use rerun::log::LogMsg;
use rerun::{AsComponents, EntityPath, RecordingStream, RecordingStreamBuilder, StoreKind};

use crate::error::StreamError;
use crate::release::{APPLICATION, SIM_TIME};
use crate::{entities, tactile};

/// Where the 3D view looks from and to, world frame, m.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Eye {
    pub position: [f32; 3],
    /// What it looks at, and turns around.
    pub target: [f32; 3],
}

impl Default for Eye {
    /// Over the table in front of the arm, from the side.
    fn default() -> Self {
        Self { position: [0.78, -0.34, 0.34], target: [0.42, -0.01, 0.13] }
    }
}

/// Properties of views that the builder does not know, by their place in the blueprint.
#[derive(Default)]
struct Properties(Vec<(EntityPath, Box<dyn AsComponents>)>);

impl Properties {
    /// Adds properties to a view and hands it on.
    fn on(&mut self, view: impl Into<ContainerLike>, properties: Vec<(&str, Box<dyn AsComponents>)>) -> ContainerLike {
        let view = view.into();
        if let ContainerLike::View(inner) = &view {
            let path = inner.blueprint_path();
            self.0.extend(properties.into_iter().map(|(name, value)| (format!("{path}/{name}").into(), value)));
        }
        view
    }

    /// A view of things in space, seen from `eye` with `up` upward.
    fn scene(&mut self, name: &str, origin: &str, eye: Eye, up: [f32; 3]) -> ContainerLike {
        let controls = EyeControls3D::new().with_position(eye.position).with_look_target(eye.target).with_eye_up(up);
        self.on(
            Spatial3DView::new(name).with_origin(origin),
            vec![
                ("EyeControls3D", Box::new(controls)),
                ("Background", Box::new(background([34, 37, 43]))),
                ("LineGrid3D", Box::new(LineGrid3D::new().with_visible(false))),
            ],
        )
    }

    fn plot(&mut self, name: &str, contents: &[&str], legend: bool) -> ContainerLike {
        let view = TimeSeriesView::new(name)
            .with_origin(entities::SIGNALS)
            .with_contents(contents.iter().map(|path| format!("/{path}")));
        let legend = PlotLegend::new().with_corner(Corner2D::LeftTop).with_visible(legend);
        let axis = TimeAxis::new().with_link(LinkAxis::LinkToGlobal);
        self.on(view, vec![("PlotLegend", Box::new(legend)), ("TimeAxis", Box::new(axis))])
    }

    fn hand_map(&mut self, name: &str, origin: &str) -> ContainerLike {
        let [columns, rows] = tactile::CELLS;
        let range = |size: f32| rerun::datatypes::Range1D([-8.0, f64::from(size)]);
        let [w, h] = tactile::CELL;
        let bounds = rerun::datatypes::Range2D { x_range: range(columns * w), y_range: range(rows * h) };
        let view = Spatial2DView::new(name).with_origin(origin);
        let bounds = VisualBounds2D::new(bounds);
        self.on(view, vec![("VisualBounds2D", Box::new(bounds)), ("Background", Box::new(background([24, 25, 28])))])
    }
}

fn layout(eye: Eye) -> (Blueprint, Properties) {
    let mut with = Properties::default();
    let world = with.scene("World", entities::WORLD, eye, [0.0, 0.0, 1.0]);
    let plots = Vertical::new([
        Horizontal::new([
            with.plot("Cable tensions (N)", &[entities::TENSIONS], true),
            Tabs::new([
                with.plot("Force on pads (N)", &[entities::PAD_FORCES], false),
                with.plot("Servo currents (A)", &[entities::CURRENTS], true),
            ])
            .into(),
        ])
        .into(),
        Horizontal::new([
            Tabs::new([
                with.plot("Finger joints (deg)", &[entities::JOINT_ANGLES], false),
                with.plot("Arm joints (deg)", &[entities::ARM_ANGLES], true),
            ])
            .into(),
            with.plot("Pose error (mm, deg)", &[entities::POSE_ERROR_MM, entities::POSE_ERROR_DEG], true),
        ])
        .into(),
    ]);
    let left = Vertical::new([world, plots.into()]).with_row_shares([0.58, 0.42]);
    let right = Vertical::new([
        with.hand_map("Tactile images", entities::TACTILE),
        with.hand_map("Height maps", entities::HEIGHTS),
        StateTimelineView::new("Phase").with_origin(entities::PHASE).into(),
        TextLogView::new("Log").with_origin("trial").into(),
    ])
    .with_row_shares([0.37, 0.37, 0.09, 0.17]);
    let blueprint = Blueprint::new(Horizontal::new([left.into(), right.into()]).with_column_shares([0.64, 0.36]))
        .with_auto_views(false)
        .with_auto_layout(false)
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(TimePanel::new().with_state(PanelState::Collapsed).with_timeline(SIM_TIME));
    (blueprint, with)
}

fn background(color: [u8; 3]) -> Background {
    Background::new(BackgroundKind::SolidColor).with_color(color)
}

/// Sends the layout into a recording.
pub fn send(rec: &RecordingStream, eye: Eye) -> Result<(), StreamError> {
    deliver(rec, layout(eye))
}

/// Sends the layout of a gallery of grasps: the hands, and beside them what there is to say.
pub fn send_gallery(rec: &RecordingStream, eye: Eye) -> Result<(), StreamError> {
    let mut with = Properties::default();
    let hands = with.scene("Grasps", entities::GALLERY, eye, [0.0, 1.0, 0.0]);
    let text = TextDocumentView::new("Grasps in words").with_origin(entities::GALLERY_TEXT);
    let blueprint = Blueprint::new(Horizontal::new([hands, text.into()]).with_column_shares([0.75, 0.25]));
    deliver(rec, (still(blueprint), with))
}

/// Sends the layout of a held object as it is felt: the hand, and beside it images and words.
pub fn send_felt(rec: &RecordingStream, eye: Eye) -> Result<(), StreamError> {
    let mut with = Properties::default();
    let hand = with.scene("Felt on the hand", entities::GALLERY, eye, [0.0, 1.0, 0.0]);
    let sheet = Spatial2DView::new("Image, normals, height and patches").with_origin(entities::SHEET);
    let text = TextDocumentView::new("In words").with_origin(entities::GALLERY_TEXT);
    let left = Vertical::new([hand, text.into()]).with_row_shares([0.75, 0.25]);
    let blueprint =
        Blueprint::new(Horizontal::new([ContainerLike::from(left), sheet.into()]).with_column_shares([0.5, 0.5]));
    deliver(rec, (still(blueprint), with))
}

/// The layout as it is, for what stands still: no panels, no time.
fn still(blueprint: Blueprint) -> Blueprint {
    blueprint
        .with_auto_views(false)
        .with_auto_layout(false)
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(TimePanel::new().with_state(PanelState::Hidden))
}

fn deliver(rec: &RecordingStream, (blueprint, properties): (Blueprint, Properties)) -> Result<(), StreamError> {
    // The builder's messages are only to be had from a recording, so they take a turn through memory.
    let (scratch, storage) = RecordingStreamBuilder::new(APPLICATION).enabled(true).memory()?;
    blueprint.send(&scratch, BlueprintActivation::default())?;
    let of_blueprint = |msg: &LogMsg| msg.store_id().kind() == StoreKind::Blueprint;
    let activation = |msg: &LogMsg| matches!(msg, LogMsg::BlueprintActivationCommand(_));
    let mut messages: Vec<LogMsg> = storage.take().into_iter().filter(|m| of_blueprint(m) && !activation(m)).collect();
    let Some(id) = messages.first().map(|msg| msg.store_id().clone()) else { return Ok(()) };

    let (extra, storage) = RecordingStreamBuilder::from_store_id(&id).enabled(true).send_properties(false).memory()?;
    extra.set_time_sequence("blueprint", 0);
    for (path, value) in &properties.0 {
        extra.log(path.clone(), value.as_ref())?;
    }
    messages.extend(storage.take().into_iter().filter(|msg| matches!(msg, LogMsg::ArrowMsg(..))));
    rec.send_blueprint(
        messages,
        BlueprintActivationCommand { blueprint_id: id, make_active: true, make_default: true },
    );
    Ok(())
}
