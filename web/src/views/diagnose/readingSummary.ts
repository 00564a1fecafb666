// How the files are read, in one line.

import { columnsOf, fallAxisOf, hasThreeCoordinates, type Setup, tracksOf, unitsNeeded } from "./setup";

/** "Columns: t in s, x and y in px; +y is up; 14 trials." Names of columns as in the file. */
export function readingSummary(setup: Setup): string {
  const first = setup.files[0];
  if (!first) return "";
  const selected = columnsOf(setup, first);
  const { pixels, pictures } = unitsNeeded(setup);
  const { reading } = setup;
  const name = (i: number): string => first.columns[i]?.name || (i < 0 ? "none" : `column ${i + 1}`);
  const bare = (i: number): string => name(i).replace(/\s*[([][^)\]]*[)\]]\s*$/, "");
  const isSpatial = hasThreeCoordinates(setup);
  const [lengthUnit, timeUnit] = [reading.lengthUnit || first.columns[selected.x]?.unit?.name || "m", reading.timeUnit || first.columns[selected.clock]?.unit?.name || "s"];
  const lengths = pixels ? `px${reading.metresPerPixel === null ? "" : ` of ${reading.metresPerPixel} m`}` : lengthUnit;
  const times = pictures ? `frames${reading.fps === null ? "" : ` at ${reading.fps} per second`}` : timeUnit;
  const axes = isSpatial ? `${bare(selected.x)}, ${bare(selected.y)} and ${bare(selected.z)}` : `${bare(selected.x)} and ${bare(selected.y)}`;
  const up = isSpatial ? upAxis(setup) : reading.yDown ? "−y is up" : "+y is up";
  const count = new Set(tracksOf(setup).map((t) => t.trial)).size;
  const trials = `${count} ${count === 1 ? "trial" : "trials"} ${selected.trial >= 0 ? `by column “${name(selected.trial)}”` : setup.files.length > 1 ? "(one each file)" : "(the whole file)"}`;
  return `Columns: ${bare(selected.clock)} in ${times}, ${axes} in ${lengths}; ${up}; ${trials}.`;
}

/** The axis that points up among three. */
function upAxis(setup: Setup): string {
  const axis = setup.reading.up || fallAxisOf(setup);
  return axis ? `${axis.startsWith("-") ? axis.replace("-", "−") : `+${axis}`} is up` : "which axis is up is not clear";
}
