//! Pictures of worlds.

use super::attempts::or_as_a_job;
use crate::access::Scope;
use crate::error::{Error, Result};
use crate::picture::{Style, animation_svg, filmstrip_svg, scene_svg, svg_to_png_within};
use crate::serve::app::App;
use crate::serve::operation::{Asked, Described, Id, Input, Media, Operation, READ, get};
use crate::serve::problem::Answer;
use crate::session::Action;

/// What can be drawn of worlds.
pub fn operations() -> Vec<Operation> {
    vec![
        get("render_world", "/v1/worlds/{id}/render", "worlds", READ)
            .about("Draws the scene, or films an action. A film in a real world is an interaction.")
            .answers_media(200, "The picture", &["image/png", "image/svg+xml"])
            .refuses(&[
                (400, ""),
                (404, ""),
                (409, "No current task"),
                (422, "Also an action that cannot be placed"),
                (429, "The budget is spent"),
            ])
            .computes(render),
    ]
}

/// A picture to draw.
struct Picture {
    png: bool,
    view: View,
    action: Option<Action>,
    /// Id of the task; the current one if absent.
    task: Option<String>,
    /// px
    width: u32,
}

/// What a picture shows.
#[derive(Clone, Copy, PartialEq)]
enum View {
    /// The scene as it stands, with the action placed if one is given.
    Scene,
    /// Moments of the rolled-out action side by side.
    Filmstrip,
    /// The rolled-out action as a moving picture.
    Animation,
}

impl Input for Picture {
    fn describe(to: &mut Described) {
        to.query::<String>("format", "`png` (default) or `svg`; an animation is SVG");
        to.query::<String>("view", "`scene` (default), `filmstrip` or `animation`");
        to.query::<String>("action", "`0.5,0.5,0.2`, or the number of a discrete action");
        to.query::<String>("task", "Id of the task; the current one if absent");
        to.query::<u32>("width", "Pixels, 16 to 4096; default 512");
    }

    fn read(from: &mut Asked) -> Answer<Picture> {
        Ok(Picture::from_query(&from.query()?)?)
    }
}

impl Picture {
    fn from_query(pairs: &[(String, String)]) -> Result<Picture> {
        let mut picture = Picture { png: true, view: View::Scene, action: None, task: None, width: 512 };
        let mut format = None;
        for (i, (key, value)) in pairs.iter().enumerate() {
            if pairs[..i].iter().any(|(k, _)| k == key) {
                return Err(Error::input(key, "given twice", "each parameter at most once"));
            }
            match key.as_str() {
                "format" => {
                    format = Some(match value.as_str() {
                        "png" => true,
                        "svg" => false,
                        _ => return Err(Error::input("format", format!("{value:?}"), "png or svg")),
                    });
                }
                "view" => {
                    picture.view = match value.as_str() {
                        "scene" => View::Scene,
                        "filmstrip" => View::Filmstrip,
                        "animation" => View::Animation,
                        _ => {
                            let allowed = "scene, filmstrip or animation";
                            return Err(Error::input("view", format!("{value:?}"), allowed));
                        }
                    };
                }
                "action" => picture.action = Some(action(value)?),
                "task" => picture.task = Some(value.clone()),
                "width" => {
                    let width = value.parse().ok().filter(|w| (16..=4096).contains(w));
                    picture.width = width.ok_or_else(|| {
                        Error::input(
                            "width",
                            format!("{value:?}"),
                            "a whole number of pixels from 16 to 4096",
                        )
                    })?;
                }
                _ => {
                    let allowed = "format, view, action, task, width";
                    return Err(Error::input(key, "not a parameter", allowed));
                }
            }
        }
        if picture.view == View::Animation && format == Some(true) {
            return Err(Error::input("format", "\"png\"", "svg for an animation"));
        }
        picture.png = format.unwrap_or(picture.view != View::Animation);
        if picture.view != View::Scene && picture.action.is_none() {
            return Err(Error::input(
                "action",
                "missing",
                "the action to film, as 0.5,0.5,0.2 or as a number",
            ));
        }
        Ok(picture)
    }
}

/// Draws; a film of an action is an attempt like any other.
fn render(app: &App, (Id(id), picture): (Id, Picture)) -> Result<Media> {
    let world = app.worlds().get(&id)?;
    let style = Style { width: picture.width, ..Style::default() };
    let svg = match (picture.view, &picture.action) {
        (View::Filmstrip, Some(action)) | (View::Animation, Some(action)) => {
            app.needs(Scope::Act)?;
            let (scene, trajectory) =
                world.film(picture.task.as_deref(), action, app.budget()).map_err(or_as_a_job)?;
            app.metrics.attempted(world.kind(), 1, u64::from(trajectory.outcome.steps));
            match picture.view {
                View::Filmstrip => filmstrip_svg(&scene, &trajectory, &style),
                View::Animation | View::Scene => animation_svg(&scene, &trajectory, &style),
            }
        }
        (_, action) => scene_svg(&world.scene(picture.task.as_deref(), action.as_ref())?, &style),
    };
    if picture.png {
        let bytes = svg_to_png_within(app.budget(), &svg, picture.width)?;
        Ok(Media { kind: "image/png", bytes })
    } else {
        Ok(Media { kind: "image/svg+xml", bytes: svg.into_bytes() })
    }
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
