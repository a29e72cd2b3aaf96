//! Layout of the viewer (Rerun blueprint). It is stored in every recording.
//!
//! Left: hand and objects in a view that follows the hand (with the whole scene on a second tab), above a view from the
//! palm and plots with a common time axis. Right: tactile images laid out as the opened hand (with their changes and
//! height maps on further tabs), above the current state, the log behind it, and the phases. The layout is the same for
//! every robot backend.
//!
//! Rerun's own builder cannot set a camera, hide a legend or link axes. These are view properties like any other,
//! logged below the view's path in the blueprint. [`send`] adds them to the builder's output.

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

use crate::error::TelemetryError;
use crate::release::{APPLICATION, SIM_TIME};
use crate::{entities, tactile};

/// Viewpoint of a 3D view: eye position and target, m, in the frame of the view's origin.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CameraViewpoint {
    pub position: [f32; 3],
    /// Target point of the eye and centre of its orbit.
    pub target: [f32; 3],
}

/// On the thumb's side of the moving hand, a little above; the arm comes from the palm's side.
const FOLLOW_VIEW: CameraViewpoint = CameraViewpoint { position: [0.33, -0.08, 0.05], target: [0.0, -0.02, -0.05] };
/// Above the table in front of the arm.
const SCENE_VIEW: CameraViewpoint = CameraViewpoint { position: [1.04, -0.46, 0.36], target: [0.40, 0.0, 0.14] };
/// Facing the palm from the grasping side.
const PALM_VIEW: CameraViewpoint = CameraViewpoint { position: [0.07, 0.02, -0.25], target: [0.0, -0.02, -0.02] };

/// View properties that the builder does not support, by their path in the blueprint.
#[derive(Default)]
struct Properties(Vec<(EntityPath, Box<dyn AsComponents>)>);

impl Properties {
    /// Adds properties to a view and returns it.
    fn with_properties(
        &mut self,
        view: impl Into<ContainerLike>,
        properties: Vec<(&str, Box<dyn AsComponents>)>,
    ) -> ContainerLike {
        let view = view.into();
        if let ContainerLike::View(inner) = &view {
            let path = inner.blueprint_path();
            self.0.extend(properties.into_iter().map(|(name, value)| (format!("{path}/{name}").into(), value)));
        }
        view
    }

    /// Returns a 3D view of everything below `origin`, seen from `eye` with `up` pointing upward.
    fn scene(&mut self, name: &str, origin: &str, eye: CameraViewpoint, up: [f32; 3]) -> ContainerLike {
        self.scene_of(name, (origin, &["+ $origin/**"]), eye, up)
    }

    /// As [`Self::scene`], but with the given `contents`.
    fn scene_of(
        &mut self,
        name: &str,
        (origin, contents): (&str, &[&str]),
        eye: CameraViewpoint,
        up: [f32; 3],
    ) -> ContainerLike {
        let controls = EyeControls3D::new().with_position(eye.position).with_look_target(eye.target).with_eye_up(up);
        self.with_properties(
            Spatial3DView::new(name).with_origin(origin).with_contents(contents.iter().copied()),
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
        self.with_properties(view, vec![("PlotLegend", Box::new(legend)), ("TimeAxis", Box::new(axis))])
    }

    fn hand_map(&mut self, name: &str, origin: &str) -> ContainerLike {
        let [columns, rows] = tactile::GRID_SIZE;
        let range = |size: f32| rerun::datatypes::Range1D([-8.0, f64::from(size)]);
        let [w, h] = tactile::CELL_SPACING;
        let bounds = rerun::datatypes::Range2D {
            x_range: range(columns * w),
            y_range: range(rows * h + tactile::HEADER_HEIGHT),
        };
        let view = Spatial2DView::new(name).with_origin(origin);
        let bounds = VisualBounds2D::new(bounds);
        self.with_properties(
            view,
            vec![("VisualBounds2D", Box::new(bounds)), ("Background", Box::new(background([24, 25, 28])))],
        )
    }
}

fn layout() -> (Blueprint, Properties) {
    let mut with = Properties::default();
    // The eye follows the hand and may pass through the arm, so only the wrist of the arm is shown.
    let arm: Vec<String> = (0..5).map(|link| format!("- /{}", entities::arm_link(link))).collect();
    let mut near = vec!["+ /world/**", "- /world/arm/base"];
    near.extend(arm.iter().map(String::as_str));
    let up = [0.0, 0.0, 1.0];
    let world = Tabs::new([
        with.scene_of("Hand and objects", (entities::FOLLOW, &near), FOLLOW_VIEW, up),
        with.scene("Whole scene", entities::WORLD, SCENE_VIEW, up),
    ]);
    // From below, the table would hide everything.
    let palm = ["+ /world/**", "- /world/table", "- /world/arm/**", "- /world/paths/**"];
    let palm = with.scene_of("From the palm", (entities::HAND, &palm), PALM_VIEW, [0.0, 1.0, 0.0]);
    let plots = Vertical::new([
        Tabs::new([
            with.plot("Cable tensions (N)", &[entities::TENSIONS], true),
            with.plot("Servo currents (A)", &[entities::CURRENTS], true),
            with.plot("Finger joints (deg)", &[entities::JOINT_ANGLES], false),
        ])
        .into(),
        Tabs::new([
            with.plot("Force on pads (N)", &[entities::PAD_FORCES], false),
            with.plot("Pose error (mm, deg)", &[entities::POSE_ERROR_MM, entities::POSE_ERROR_DEG], true),
            with.plot("Arm joints (deg)", &[entities::ARM_ANGLES], true),
            with.plot("Residuals (N)", &[entities::RESIDUAL_LOADS, entities::RESIDUAL_FORCE], true),
        ])
        .into(),
    ]);
    let below = Horizontal::new([palm, plots.into()]).with_column_shares([0.46, 0.54]);
    let left = Vertical::new([world.into(), below.into()]).with_row_shares([0.58, 0.42]);
    let right = Vertical::new([
        Tabs::new([
            with.hand_map("Tactile images", entities::TACTILE),
            with.hand_map("Change from untouched", entities::CHANGES),
            with.hand_map("Height maps", entities::HEIGHTS),
        ])
        .into(),
        Tabs::new([
            ContainerLike::from(TextDocumentView::new("Now").with_origin(entities::STATE_PAGE)),
            TextLogView::new("Log").with_origin("trial").into(),
        ])
        .into(),
        StateTimelineView::new("Phase").with_origin(entities::PHASE).into(),
    ])
    .with_row_shares([0.42, 0.48, 0.10]);
    let blueprint = Blueprint::new(Horizontal::new([left.into(), right.into()]).with_column_shares([0.61, 0.39]))
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
pub fn send(rec: &RecordingStream) -> Result<(), TelemetryError> {
    send_layout(rec, layout())
}

/// Sends the layout of a gallery of grasps: the hands with a text panel beside them.
pub fn send_gallery(rec: &RecordingStream, eye: CameraViewpoint) -> Result<(), TelemetryError> {
    let mut with = Properties::default();
    let hands = with.scene("Grasps", entities::GALLERY, eye, [0.0, 1.0, 0.0]);
    let text = TextDocumentView::new("Grasps in words").with_origin(entities::GALLERY_TEXT);
    let blueprint = Blueprint::new(Horizontal::new([hands, text.into()]).with_column_shares([0.75, 0.25]));
    send_layout(rec, (static_layout(blueprint), with))
}

/// Sends the layout of a held object as perceived by touch: the hand, with images and text beside it.
pub fn send_estimated_scene(rec: &RecordingStream, eye: CameraViewpoint) -> Result<(), TelemetryError> {
    let mut with = Properties::default();
    let hand = with.scene("Perceived in the hand", entities::GALLERY, eye, [0.0, 1.0, 0.0]);
    let sheet = Spatial2DView::new("Image, normals, height and patches").with_origin(entities::IMAGE_SHEET);
    let text = TextDocumentView::new("In words").with_origin(entities::GALLERY_TEXT);
    let left = Vertical::new([hand, text.into()]).with_row_shares([0.75, 0.25]);
    let blueprint =
        Blueprint::new(Horizontal::new([ContainerLike::from(left), sheet.into()]).with_column_shares([0.5, 0.5]));
    send_layout(rec, (static_layout(blueprint), with))
}

/// Returns the layout for a static scene: panels collapsed, time panel hidden.
fn static_layout(blueprint: Blueprint) -> Blueprint {
    blueprint
        .with_auto_views(false)
        .with_auto_layout(false)
        .with_blueprint_panel(BlueprintPanel::from_state(PanelState::Collapsed))
        .with_selection_panel(SelectionPanel::from_state(PanelState::Collapsed))
        .with_time_panel(TimePanel::new().with_state(PanelState::Hidden))
}

fn send_layout(rec: &RecordingStream, (blueprint, properties): (Blueprint, Properties)) -> Result<(), TelemetryError> {
    // Rerun exposes the builder's messages only through a recording, so they pass through one in memory.
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
