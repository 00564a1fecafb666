// Files: dropped anywhere on the view, or chosen; several are a launch each.

import { FileError } from "../../api/problem";
import { uniqueId, h } from "../../dom";
import { yieldToBrowser } from "../../parts/yieldToBrowser";
import { cut, type Cut } from "./file";

/** The place for files; `taken` has them cut. */
export function intake(place: HTMLElement, taken: (files: Cut[]) => Promise<void>, fail: (error: unknown) => void, signal: AbortSignal): HTMLElement {
  const id = uniqueId("tracks");
  const input = h("input", { id, type: "file", accept: ".csv,.tsv,.txt,text/csv,text/plain", multiple: true, class: "unseen" });
  const zone = h(
    "div",
    { class: "drop file" },
    input,
    h("label", { for: id, class: "button" }, "Choose tracks (CSV)"),
    h("span", { class: "soft" }, "or drop them here. As Tracker, Kinovea or a data frame write them; several files are a launch each."),
  );
  const take = (files: readonly File[]): void => {
    if (!files.length) return;
    cuts(files)
      .then((found) => (signal.aborted ? undefined : taken(found)))
      .catch(fail);
  };
  input.addEventListener("change", () => {
    take([...(input.files ?? [])]);
    input.value = "";
  });
  const over = (event: DragEvent): void => {
    if (!event.dataTransfer?.types.includes("Files")) return;
    event.preventDefault();
    zone.classList.add("over");
  };
  place.addEventListener("dragover", over, { signal });
  place.addEventListener("dragleave", () => zone.classList.remove("over"), { signal });
  place.addEventListener(
    "drop",
    (event) => {
      zone.classList.remove("over");
      const files = [...(event.dataTransfer?.files ?? [])];
      if (!files.length) return;
      event.preventDefault();
      take(files);
    },
    { signal },
  );
  return zone;
}

/** Files cut one at a time, so that the page stays quick between them. */
async function cuts(files: readonly File[]): Promise<Cut[]> {
  const found: Cut[] = [];
  for (const file of files) {
    found.push(cut(file.name, await text(file)));
    await yieldToBrowser();
  }
  return found;
}

async function text(file: File): Promise<string> {
  try {
    return new TextDecoder("utf-8", { fatal: true }).decode(await file.arrayBuffer());
  } catch (e) {
    if (e instanceof TypeError) throw new FileError(file.name, "it is no text (UTF-8), so it holds no table of tracks");
    throw e;
  }
}
