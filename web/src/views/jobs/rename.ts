// The name of a job, changed in place: Enter saves, Escape discards.

import { h, put } from "../../dom";
import type { Context } from "../../view";
import { changeJob, type Job, titleOf } from "./job";

export interface EditableName {
  element: HTMLElement;
  /** Displays the job, unless its name is being edited. */
  show: (job: Job) => void;
}

/** Maximum length of a name, characters. */
const MAX_NAME_CHARACTERS = 200;

/** `label` displays the title: a heading or a link. */
export function editableName(first: Job, label: (job: Job) => HTMLElement, context: Context): EditableName {
  let [job, editing] = [first, false];
  const element = h("div", { class: "job-name" });
  const edit = h("button", { type: "button", class: "quiet rename", "aria-label": `Rename ${job.id}`, title: "Rename" }, "✎");
  const display = (): void => {
    editing = false;
    put(element, label(job), edit);
  };
  const close = (): void => {
    display();
    edit.focus();
  };
  const open = (): void => {
    editing = true;
    const input = h("input", { type: "text", "aria-label": `Name of ${job.id}`, maxlength: MAX_NAME_CHARACTERS, value: job.name ?? "", placeholder: titleOf({ ...job, name: "" }), autocomplete: "off" });
    const save = h("button", { type: "submit", class: "main" }, "Save");
    const discard = h("button", { type: "button" }, "Discard");
    const form = h("form", { class: "row" }, input, save, discard);
    form.addEventListener("submit", (event) => {
      event.preventDefault();
      save.disabled = true;
      context.fail(null);
      const name = input.value.trim();
      changeJob(job.id, { name })
        .then(() => ((job = { ...job, name }), close(), context.say(`${job.id} is named ${titleOf(job)}.`)))
        .catch((e: unknown) => ((save.disabled = false), context.fail(e)));
    });
    input.addEventListener("keydown", (event) => event.key === "Escape" && close());
    discard.addEventListener("click", close);
    put(element, form);
    input.focus();
    input.select();
  };
  edit.addEventListener("click", open);
  display();
  return {
    element,
    show: (now) => {
      const renamed = titleOf(now) !== titleOf(job);
      job = now;
      if (renamed && !editing) display();
    },
  };
}
