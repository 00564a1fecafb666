//! XML files of TrackMate: its tracks alone (`Tracks`), and its whole model (`TrackMate`).

use std::collections::{BTreeSet, HashMap};

use roxmltree::{Document, Node};

use super::columns::{ColumnQuantity, LENGTHS, TIMES, TrackColumn, unit_named};
use super::table::Table;
use super::track_rows::invalid_value;
use super::xml::{attribute, children, line, number};
use crate::error::Result;

/// The tracks of a document; `None` if it is not of TrackMate.
pub fn table(document: &Document) -> Result<Option<Table>> {
    let root = document.root_element();
    match root.tag_name().name() {
        "Tracks" => tracks_alone(root).map(Some),
        "TrackMate" => model(root).map(Some),
        _ => Ok(None),
    }
}

/// `<Tracks><particle><detection t="frame" x y z/>`.
fn tracks_alone(root: Node) -> Result<Table> {
    let mut records = Vec::new();
    for (i, particle) in children(root, "particle").enumerate() {
        for spot in children(particle, "detection") {
            let cell = |name: &str| attribute(spot, name).map(String::from);
            records.push((line(spot), vec![i.to_string(), cell("t")?, cell("x")?, cell("y")?, cell("z")?]));
        }
    }
    let interval = number(root, "frameInterval").unwrap_or(0.0);
    let seconds = root.attribute("timeUnits").and_then(|u| unit_named(&TIMES, u)).and_then(|u| u.size);
    let mut table = Table::new(1, columns(root.attribute("spaceUnits"), time("frame", None)), records);
    table.frame_rate = seconds.filter(|_| interval > 0.0).map(|s| 1.0 / (s * interval));
    Ok(table)
}

/// `<Model><AllSpots>` with `<Spot ID POSITION_X .../>`, and `<AllTracks>` with the edges between spots.
fn model(root: Node) -> Result<Table> {
    let model = children(root, "Model").next();
    let model = model.ok_or_else(|| invalid_value(1, "Model", "missing", "a model of TrackMate"))?;
    let spots: HashMap<&str, Node> = model
        .descendants()
        .filter(|n| n.has_tag_name("Spot"))
        .filter_map(|spot| Some((spot.attribute("ID")?, spot)))
        .collect();
    let mut records = Vec::new();
    for track in model.descendants().filter(|n| n.has_tag_name("Track")) {
        let name = attribute(track, "name").or_else(|_| attribute(track, "TRACK_ID"))?;
        let mut own: BTreeSet<&str> = BTreeSet::new();
        for edge in children(track, "Edge") {
            own.extend([attribute(edge, "SPOT_SOURCE_ID")?, attribute(edge, "SPOT_TARGET_ID")?]);
        }
        let mut rows = Vec::new();
        for id in own {
            let Some(spot) = spots.get(id) else {
                return Err(invalid_value(
                    line(track),
                    "Edge",
                    &format!("of spot {id}"),
                    "spots of the file",
                ));
            };
            let cell = |name: &str| attribute(*spot, name).map(String::from);
            let cells = [cell("POSITION_T")?, cell("POSITION_X")?, cell("POSITION_Y")?, cell("POSITION_Z")?];
            rows.push((
                number(*spot, "POSITION_T")?,
                line(*spot),
                [vec![name.to_string()], cells.to_vec()].concat(),
            ));
        }
        rows.sort_by(|a, b| a.0.total_cmp(&b.0));
        records.extend(rows.into_iter().map(|(_, line, cells)| (line, cells)));
    }
    let clock = model.attribute("timeunits");
    Ok(Table::new(1, columns(model.attribute("spatialunits"), time("POSITION_T", clock)), records))
}

fn time(name: &str, unit: Option<&str>) -> TrackColumn {
    let quantity = if name == "frame" { ColumnQuantity::Frame } else { ColumnQuantity::Time };
    TrackColumn::of_quantity(name, quantity, unit.and_then(|u| unit_named(&TIMES, u)))
}

fn columns(unit: Option<&str>, time: TrackColumn) -> Vec<TrackColumn> {
    let unit = unit.and_then(|u| unit_named(&LENGTHS, u));
    let coordinate = |name: &str, quantity| TrackColumn::of_quantity(name, quantity, unit);
    vec![
        TrackColumn::of_quantity("track", ColumnQuantity::TrackNumber, None),
        time,
        coordinate("x", ColumnQuantity::X),
        coordinate("y", ColumnQuantity::Y),
        coordinate("z", ColumnQuantity::Z),
    ]
}
