//! Pictures of worlds.

use crate::error::{Error, Result};
use crate::picture::{Style, animation_svg, filmstrip_svg, scene_svg, svg_to_png};
use crate::serve::app::App;
use crate::session::Action;

/// A picture to draw.
#[derive(Clone, Debug, PartialEq)]
pub struct Picture {
    pub png: bool,
    pub view: View,
    pub action: Option<Action>,
    /// Id of the task; the current one if absent.
    pub task: Option<String>,
    /// px
    pub width: u32,
}

/// What a picture shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum View {
    /// The scene as it stands, with the action placed if one is given.
    Scene,
    /// Moments of the rolled-out action side by side.
    Filmstrip,
    /// The rolled-out action as a moving picture.
    Animation,
}

/// A picture with its media type.
pub struct Drawn {
    pub kind: &'static str,
    pub bytes: Vec<u8>,
}

impl Picture {
    /// Reads query parameters.
    pub fn from_query(pairs: &[(String, String)]) -> Result<Picture> {
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
pub fn render(app: &App, id: &str, picture: &Picture) -> Result<Drawn> {
    let world = app.worlds.get(id, app.now())?;
    let style = Style { width: picture.width, ..Style::default() };
    let svg = match (picture.view, &picture.action) {
        (View::Filmstrip, Some(action)) | (View::Animation, Some(action)) => {
            let (scene, trajectory) = world.film(picture.task.as_deref(), action)?;
            app.metrics.attempted(world.kind(), 1);
            match picture.view {
                View::Filmstrip => filmstrip_svg(&scene, &trajectory, &style),
                View::Animation | View::Scene => animation_svg(&scene, &trajectory, &style),
            }
        }
        (_, action) => scene_svg(&world.scene(picture.task.as_deref(), action.as_ref())?, &style),
    };
    if picture.png {
        Ok(Drawn { kind: "image/png", bytes: svg_to_png(&svg, picture.width)? })
    } else {
        Ok(Drawn { kind: "image/svg+xml", bytes: svg.into_bytes() })
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
