// File input by drag and drop or file dialog; each of several files is a trial.

import { FileError } from "../../api/problem";
import { uniqueId, h } from "../../dom";
import { yieldToBrowser } from "../../parts/yieldToBrowser";
import { parseFile, type ParsedFile } from "./parseFile";

/** The drop zone; `onFiles` gets the parsed files. */
export function fileInput(place: HTMLElement, onFiles: (files: ParsedFile[]) => Promise<void>, fail: (error: unknown) => void, signal: AbortSignal): HTMLElement {
  const id = uniqueId("tracks");
  const input = h("input", { id, type: "file", accept: ".csv,.tsv,.txt,text/csv,text/plain", multiple: true, class: "unseen" });
  const zone = h(
    "div",
    { class: "drop file" },
    input,
    h("label", { for: id, class: "button" }, "Choose tracks (CSV)"),
    h("span", { class: "soft" }, "or drop them here, as written by Tracker, Kinovea or pandas; each of several files is one trial."),
  );
  const readFiles = (files: readonly File[]): void => {
    if (!files.length) return;
    parseFiles(files)
      .then((parsed) => (signal.aborted ? undefined : onFiles(parsed)))
      .catch(fail);
  };
  input.addEventListener("change", () => {
    readFiles([...(input.files ?? [])]);
    input.value = "";
  });
  const onDragOver = (event: DragEvent): void => {
    if (!event.dataTransfer?.types.includes("Files")) return;
    event.preventDefault();
    zone.classList.add("over");
  };
  place.addEventListener("dragover", onDragOver, { signal });
  place.addEventListener("dragleave", () => zone.classList.remove("over"), { signal });
  place.addEventListener(
    "drop",
    (event) => {
      zone.classList.remove("over");
      const files = [...(event.dataTransfer?.files ?? [])];
      if (!files.length) return;
      event.preventDefault();
      readFiles(files);
    },
    { signal },
  );
  return zone;
}

/** Parses files one at a time, to keep the page responsive. */
async function parseFiles(files: readonly File[]): Promise<ParsedFile[]> {
  const parsed: ParsedFile[] = [];
  for (const file of files) {
    parsed.push(parseFile(file.name, await text(file)));
    await yieldToBrowser();
  }
  return parsed;
}

async function text(file: File): Promise<string> {
  try {
    return new TextDecoder("utf-8", { fatal: true }).decode(await file.arrayBuffer());
  } catch (e) {
    if (e instanceof TypeError) throw new FileError(file.name, "it is not a UTF-8 text file");
    throw e;
  }
}
