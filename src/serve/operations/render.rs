//! Pictures of worlds.

use super::attempts::or_as_a_job;
use crate::access::Scope;
use crate::error::{Error, Result};
use crate::picture::reel::{self, FASTEST, FPS};
use crate::picture::{Style, animation_svg, end_svg, film_png, filmstrip_svg, scene_svg, svg_to_png_within};
use crate::serve::app::App;
use crate::serve::operation::{Asked, Described, Id, Input, Media, Operation, READ, get};
use crate::serve::problem::Answer;
use crate::session::{Action, World};
use crate::task::Scene;
use crate::trajectory::Trajectory;

/// What can be drawn of worlds.
pub fn operations() -> Vec<Operation> {
    vec![
        get("render_world", "/v1/worlds/{id}/render", "worlds", READ)
            .about(
                "Draws the scene, or films the step that was made last (at no interaction) or an action that is attempted for \
                 it (which is one).",
            )
            .answers_media(200, "The picture", &["image/png", "image/svg+xml", "image/apng"])
            .refuses(&[
                (400, ""),
                (404, ""),
                (409, "No current task, or no step to film"),
                (413, "A film too long or too large"),
                (422, "Also an action that cannot be placed"),
                (429, "The budget is spent"),
            ])
            .computes(render),
    ]
}

/// A picture to draw.
struct Picture {
    form: Form,
    view: View,
    action: Option<Action>,
    /// Id of the task; the current one if absent.
    task: Option<String>,
    /// px
    width: u32,
    /// Frames a second, of a film.
    fps: u32,
}

/// What a picture is written as.
#[derive(Clone, Copy, PartialEq)]
enum Form {
    Png,
    Svg,
}

/// What a picture shows.
#[derive(Clone, Copy, PartialEq)]
enum View {
    /// The scene as it stands, with the action placed if one is given.
    Scene,
    /// The scene at the end of what an action brought.
    End,
    /// Moments of it side by side.
    Filmstrip,
    /// All of it as a moving picture: SVG that plays in a browser.
    Animation,
    /// All of it frame by frame: an animated PNG.
    Film,
}

/// Names of the views.
const VIEWS: [(&str, View); 5] = [
    ("scene", View::Scene),
    ("end", View::End),
    ("filmstrip", View::Filmstrip),
    ("animation", View::Animation),
    ("film", View::Film),
];

impl Input for Picture {
    fn describe(to: &mut Described) {
        to.query::<String>("format", "`png` (default) or `svg`; an animation is SVG, a film an animated PNG");
        to.query::<String>("view", "`scene` (default), `end`, `filmstrip`, `animation` or `film`");
        to.query::<String>(
            "action",
            "`0.5,0.5,0.2`, or the number of a discrete action: placed in the scene, attempted in any other view; without it \
             they show the last step that could be placed",
        );
        to.query::<String>("task", "Id of the task; the current one if absent");
        to.query::<u32>("width", "Pixels, 16 to 4096; default 512");
        to.query::<u32>("fps", "Frames a second of a film, 1 to 60; default 30");
    }

    fn read(from: &mut Asked) -> Answer<Picture> {
        Ok(Picture::from_query(&from.query()?)?)
    }
}

impl Picture {
    fn from_query(pairs: &[(String, String)]) -> Result<Picture> {
        let mut picture =
            Picture { form: Form::Png, view: View::Scene, action: None, task: None, width: 512, fps: FPS };
        let (mut form, mut fps) = (None, None);
        for (i, (key, value)) in pairs.iter().enumerate() {
            if pairs[..i].iter().any(|(k, _)| k == key) {
                return Err(Error::input(key, "given twice", "each parameter at most once"));
            }
            let refuse = |allowed: &str| Error::input(key, format!("{value:?}"), allowed);
            match key.as_str() {
                "format" => {
                    form = Some(match value.as_str() {
                        "png" => Form::Png,
                        "svg" => Form::Svg,
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
                        Some(whole(value, 1..=FASTEST).ok_or_else(|| refuse("a whole number from 1 to 60"))?);
                }
                _ => {
                    let allowed = "format, view, action, task, width, fps";
                    return Err(Error::input(key, "not a parameter", allowed));
                }
            }
        }
        picture.settled(form, fps)
    }

    /// With what follows from the view; errors if anything does not go with it.
    fn settled(mut self, form: Option<Form>, fps: Option<u32>) -> Result<Picture> {
        if fps.is_some() && self.view != View::Film {
            return Err(Error::input("fps", "given", "nothing, but with view=film"));
        }
        self.fps = fps.unwrap_or(FPS);
        self.form = match (self.view, form) {
            (View::Animation, Some(Form::Png)) => {
                return Err(Error::input("format", "\"png\"", "svg for an animation; view=film is PNG"));
            }
            (View::Film, Some(Form::Svg)) => {
                return Err(Error::input("format", "\"svg\"", "png for a film; view=animation is SVG"));
            }
            (View::Animation, None) => Form::Svg,
            (_, form) => form.unwrap_or(Form::Png),
        };
        if let (None, Some(task), true) = (&self.action, &self.task, self.view != View::Scene) {
            let allowed = "nothing without an `action`: the last step is of the task it was made on";
            return Err(Error::input("task", format!("{task:?}"), allowed));
        }
        Ok(self)
    }
}

/// Draws; what an action is attempted for is an attempt like any other.
fn render(app: &App, (Id(id), picture): (Id, Picture)) -> Result<Media> {
    let world = app.worlds().get(&id)?;
    let style = Style { width: picture.width, ..Style::default() };
    let svg = if picture.view == View::Scene {
        scene_svg(&world.scene(picture.task.as_deref(), picture.action.as_ref())?, &style)
    } else {
        let (scene, trajectory) = brought(app, &world, &picture)?;
        match picture.view {
            View::Film => {
                let bytes = film_png(app.budget(), &scene, &trajectory, &style, picture.fps)?;
                return Ok(Media { kind: "image/apng", bytes });
            }
            View::Filmstrip => filmstrip_svg(&scene, &trajectory, &style),
            View::Animation => animation_svg(&scene, &trajectory, &style),
            View::End | View::Scene => end_svg(&scene, &trajectory, &style),
        }
    };
    if picture.form == Form::Svg {
        return Ok(Media { kind: "image/svg+xml", bytes: svg.into_bytes() });
    }
    let bytes = svg_to_png_within(app.budget(), &svg, picture.width)?;
    Ok(Media { kind: "image/png", bytes })
}

/// What the action brings, or what the last step brought.
fn brought(app: &App, world: &World, picture: &Picture) -> Result<(Scene, Trajectory)> {
    let affordable = |scene: &Scene, seconds: f64| match picture.view {
        View::Film => reel::affordable(scene, seconds, picture.width, picture.fps),
        _ => Ok(()),
    };
    let Some(action) = &picture.action else {
        let (scene, trajectory) = world.last_step(app.budget())?;
        let seconds = trajectory.times.last().zip(trajectory.times.first()).map_or(0.0, |(b, a)| b - a);
        affordable(&scene, seconds)?;
        return Ok((scene, trajectory));
    };
    app.needs(Scope::Act)?;
    // Before anything is attempted, by the longest that it can take.
    let scene = world.scene(picture.task.as_deref(), None)?;
    affordable(&scene, scene.time_step * f64::from(scene.steps))?;
    let film = world.film(picture.task.as_deref(), action, app.budget()).map_err(or_as_a_job)?;
    app.metrics.attempted(world.kind(), 1, u64::from(film.1.outcome.steps));
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
