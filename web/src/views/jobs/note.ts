// The note of a job: saved while typing, and when the field is left.

import { h, put, uniqueId } from "../../dom";
import { describeError } from "../../api/problem";
import { changeJob, type Job } from "./job";

export interface JobNote {
  element: HTMLElement;
  /** Displays the note of the job, unless it is being edited. */
  show: (job: Job) => void;
}

/** Pause in typing after which the note is saved, ms. */
const PAUSE_MS = 800;

export function jobNote(job: Job, signal: AbortSignal): JobNote {
  const id = uniqueId("note");
  const area = h("textarea", { id, rows: 4, placeholder: "Why it was started, what it showed, what to try next. Everybody who sees the job can read it." });
  const status = h("span", { class: "soft small", role: "status" });
  let [saved, timer, saving] = [job.note ?? "", 0, Promise.resolve()];
  const save = (): void => {
    clearTimeout(timer);
    const note = area.value;
    if (note === saved) return;
    put(status, "Saving …");
    saving = saving
      .then(() => changeJob(job.id, { note }))
      .then(() => ((saved = note), void put(status, area.value === note ? "Saved" : "Saving …")))
      .catch((e: unknown) => void put(status, `Not saved: ${describeError(e).detail}`));
  };
  area.addEventListener("input", () => {
    put(status, area.value === saved ? null : "Not saved yet");
    clearTimeout(timer);
    timer = setTimeout(save, PAUSE_MS) as unknown as number;
  });
  area.addEventListener("change", save);
  // A view that is left removes the field without a change event.
  signal.addEventListener("abort", save);
  area.value = saved;
  const heading = h("h2", {}, h("label", { for: id }, "Note"));
  const element = h("section", { class: "card stack note", "aria-label": "Note" }, h("div", { class: "row between" }, heading, status), area);
  return {
    element,
    show: (now) => {
      const isEdited = area.value !== saved || document.activeElement === area;
      if (isEdited || now.note === undefined) return;
      saved = now.note;
      area.value = saved;
    },
  };
}
