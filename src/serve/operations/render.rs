//! Rendering of worlds.

use super::rollouts::suggest_job;
use crate::access::Scope;
use crate::error::{Error, Result};
use crate::picture::apng::{self, DEFAULT_FPS, MAX_FPS};
use crate::picture::{
    Style, animation_png, animation_svg, filmstrip_svg, final_frame_svg, scene_svg, svg_to_png_within,
};
use crate::serve::operation::{
    Extractor, MediaBody, Operation, OperationDoc, OperationRequest, PathId, READ, get,
};
use crate::serve::problem::HandlerResult;
use crate::serve::request_context::RequestContext;
use crate::session::{Action, World};
use crate::task::Scene;
use crate::trajectory::Trajectory;

/// Operations that render worlds.
pub fn operations() -> Vec<Operation> {
    vec![
        get("render_world", "/v1/worlds/{id}/render", "worlds", READ)
            .about(
                "Renders the scene, the last step (not counted), or an action that is attempted for it (counted as an \
                 interaction).",
            )
            .media_response(200, "The image", &["image/png", "image/svg+xml", "image/apng"])
            .errors(&[
                (400, ""),
                (404, ""),
                (409, "No current task, or no step to render"),
                (413, "The film is too long or too large"),
                (422, "Invalid parameters, or an action that cannot be placed"),
                (429, "The budget is spent"),
            ])
            .compute_handler(render),
    ]
}

/// Query parameters of a render.
struct RenderQuery {
    form: ImageFormat,
    view: RenderView,
    action: Option<Action>,
    /// Id of the task. Default: the current task.
    task: Option<String>,
    /// px
    width: u32,
    /// Frames per second of a film.
    fps: u32,
}

/// Image format.
#[derive(Clone, Copy, PartialEq)]
enum ImageFormat {
    Png,
    Svg,
}

/// Sampled states of bodies that are drawn, in about 0.1 s; of more, every second, third, ... sample is.
const MAX_DRAWN_STATES: usize = 20_000;

/// Content of the image.
#[derive(Clone, Copy, PartialEq)]
enum RenderView {
    /// The initial scene, with the action placed if one is given.
    Scene,
    /// The final state of the rollout.
    End,
    /// Frames of the rollout side by side.
    Filmstrip,
    /// The rollout as an animated SVG.
    Animation,
    /// The rollout as an animated PNG.
    Film,
}

/// Names of the views.
const VIEWS: [(&str, RenderView); 5] = [
    ("scene", RenderView::Scene),
    ("end", RenderView::End),
    ("filmstrip", RenderView::Filmstrip),
    ("animation", RenderView::Animation),
    ("film", RenderView::Film),
];

impl Extractor for RenderQuery {
    fn describe(to: &mut OperationDoc) {
        to.query::<String>("format", "`png` (default) or `svg`; an animation is SVG, a film an animated PNG");
        to.query::<String>("view", "`scene` (default), `end`, `filmstrip`, `animation` or `film`");
        to.query::<String>(
            "action",
            "`0.5,0.5,0.2`, or the index of a discrete action: placed in the scene, attempted in other views; without it they \
             show the last valid step",
        );
        to.query::<String>("task", "Id of the task. Default: the current task");
        to.query::<u32>("width", "Width in pixels, 16 to 4096. Default: 512");
        to.query::<u32>("fps", "Frames per second of a film, 1 to 60. Default: 30");
    }

    fn extract(from: &mut OperationRequest) -> HandlerResult<RenderQuery> {
        Ok(RenderQuery::from_query(&from.query()?)?)
    }
}

impl RenderQuery {
    fn from_query(pairs: &[(String, String)]) -> Result<RenderQuery> {
        let mut picture = RenderQuery {
            form: ImageFormat::Png,
            view: RenderView::Scene,
            action: None,
            task: None,
            width: 512,
            fps: DEFAULT_FPS,
        };
        let (mut form, mut fps) = (None, None);
        for (i, (key, value)) in pairs.iter().enumerate() {
            if pairs[..i].iter().any(|(k, _)| k == key) {
                return Err(Error::input(key, "given twice", "each parameter at most once"));
            }
            let refuse = |allowed: &str| Error::input(key, format!("{value:?}"), allowed);
            match key.as_str() {
                "format" => {
                    form = Some(match value.as_str() {
                        "png" => ImageFormat::Png,
                        "svg" => ImageFormat::Svg,
                        _ => return Err(refuse("png or svg")),
                    });
                }
                "view" => {
                    let known = VIEWS.iter().find(|(name, _)| name == value);
                    picture.view = known.ok_or_else(|| refuse("scene, end, filmstrip, animation or film"))?.1;
                }
                "action" => picture.action = Some(action(value)?),
                "task" => picture.task = Some(value.clone()),
                "width" => {
                    picture.width = whole(value, 16..=4096)
                        .ok_or_else(|| refuse("a whole number of pixels from 16 to 4096"))?;
                }
                "fps" => {
                    fps =
                        Some(whole(value, 1..=MAX_FPS).ok_or_else(|| refuse("a whole number from 1 to 60"))?);
                }
                _ => {
                    let allowed = "format, view, action, task, width, fps";
                    return Err(Error::input(key, "not a parameter", allowed));
                }
            }
        }
        picture.with_defaults(form, fps)
    }

    /// Fills in defaults that depend on the view; fails if parameters do not match it.
    fn with_defaults(mut self, form: Option<ImageFormat>, fps: Option<u32>) -> Result<RenderQuery> {
        if fps.is_some() && self.view != RenderView::Film {
            return Err(Error::input("fps", "given", "no fps, except with view=film"));
        }
        self.fps = fps.unwrap_or(DEFAULT_FPS);
        self.form = match (self.view, form) {
            (RenderView::Animation, Some(ImageFormat::Png)) => {
                return Err(Error::input("format", "\"png\"", "svg for an animation; view=film is PNG"));
            }
            (RenderView::Film, Some(ImageFormat::Svg)) => {
                return Err(Error::input("format", "\"svg\"", "png for a film; view=animation is SVG"));
            }
            (RenderView::Animation, None) => ImageFormat::Svg,
            (_, form) => form.unwrap_or(ImageFormat::Png),
        };
        if let (None, Some(task), true) = (&self.action, &self.task, self.view != RenderView::Scene) {
            let allowed = "no task without an `action`: the last step has its own task";
            return Err(Error::input("task", format!("{task:?}"), allowed));
        }
        Ok(self)
    }
}

/// Renders a view; attempting an action for it counts.
fn render(app: &RequestContext, (PathId(id), picture): (PathId, RenderQuery)) -> Result<MediaBody> {
    let world = app.worlds().get(&id)?.world;
    let style = Style { width: picture.width, ..Style::default() };
    let svg = if picture.view == RenderView::Scene {
        scene_svg(&world.scene(picture.task.as_deref(), picture.action.as_ref())?, &style)
    } else {
        let (scene, trajectory) = trajectory_to_draw(app, &world, &picture)?;
        let trajectory = trajectory.thinned(MAX_DRAWN_STATES);
        app.budget().check()?;
        match picture.view {
            RenderView::Film => {
                let bytes = animation_png(app.budget(), &scene, &trajectory, &style, picture.fps)?;
                return Ok(MediaBody { kind: "image/apng", bytes });
            }
            RenderView::Filmstrip => filmstrip_svg(&scene, &trajectory, &style),
            RenderView::Animation => animation_svg(&scene, &trajectory, &style),
            RenderView::End | RenderView::Scene => final_frame_svg(&scene, &trajectory, &style),
        }
    };
    if picture.form == ImageFormat::Svg {
        return Ok(MediaBody { kind: "image/svg+xml", bytes: svg.into_bytes() });
    }
    let bytes = svg_to_png_within(app.budget(), &svg, picture.width)?;
    Ok(MediaBody { kind: "image/png", bytes })
}

/// The placed scene and trajectory of the action, or of the last step.
fn trajectory_to_draw(
    app: &RequestContext,
    world: &World,
    picture: &RenderQuery,
) -> Result<(Scene, Trajectory)> {
    let check_size = |scene: &Scene, seconds: f64| match picture.view {
        RenderView::Film => apng::check_size(scene, seconds, picture.width, picture.fps),
        _ => Ok(()),
    };
    let Some(action) = &picture.action else {
        let (scene, trajectory) = world.last_step(app.budget())?;
        let seconds = trajectory.times.last().zip(trajectory.times.first()).map_or(0.0, |(b, a)| b - a);
        check_size(&scene, seconds)?;
        return Ok((scene, trajectory));
    };
    app.require_scope(Scope::Act)?;
    // Check the cost before the attempt, for the maximum duration.
    let scene = world.scene(picture.task.as_deref(), None)?;
    check_size(&scene, scene.time_step * f64::from(scene.steps))?;
    let film = world.record(picture.task.as_deref(), action, app.budget()).map_err(suggest_job)?;
    app.metrics.count_attempts(world.kind(), 1, u64::from(film.1.outcome.steps));
    Ok(film)
}

/// A whole number within a range.
fn whole(text: &str, range: std::ops::RangeInclusive<u32>) -> Option<u32> {
    text.parse().ok().filter(|v| range.contains(v))
}

/// `0.5,0.5,0.2` is a vector, `123` a discrete action.
fn action(text: &str) -> Result<Action> {
    let refuse = || {
        Error::input("action", format!("{text:?}"), "numbers from 0 to 1 as 0.5,0.5,0.2, or a whole number")
    };
    if let Ok(index) = text.parse() {
        return Ok(Action::Index(index));
    }
    let values: Option<Vec<f64>> = text.split(',').map(|v| v.trim().parse().ok()).collect();
    values.map(Action::Vector).ok_or_else(refuse)
}
