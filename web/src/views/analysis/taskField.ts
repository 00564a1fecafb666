// The field for a task: its id, its picture, and the gallery of all tasks.

import type { Schema } from "../../api/client";
import { h, put } from "../../dom";
import { type RequestField, textField } from "../../parts/requestField";
import { picture } from "../../scene/draw";
import type { Context } from "../../view";
import { gallery, loadTask } from "../play/taskPicker";

export interface TaskField {
  element: HTMLElement;
  field: RequestField<HTMLInputElement>;
  value: () => string;
}

/** A field with the id of a task, or of a family where the help says so. */
export function taskField(families: Schema<"FamilyOut">[], id: string, help: string, context: Context): TaskField {
  const field = textField("Task", "task", id, { help });
  const thumbnail = h("span", { class: "task-thumbnail", "aria-hidden": "true" });
  const { button, dialog } = gallery(families, (picked) => {
    field.input.value = picked;
    field.showError(null);
    void showPicture();
  }, context);
  const showPicture = async (): Promise<void> => {
    const task = field.input.value.trim();
    const family = families.find((f) => f.name === task.split(":")[0]);
    const number = Number(task.split(":")[1] ?? 0);
    if (!family || !(number < family.tasks)) return void put(thumbnail);
    const { scene } = await loadTask(`${family.name}:${number}`, context.signal);
    put(thumbnail, picture(scene, "").svg);
  };
  field.input.addEventListener("change", () => void showPicture().catch(context.fail));
  showPicture().catch(context.fail);
  field.input.after(button);
  const element = h("div", { class: "task-field" }, field.element, thumbnail, dialog);
  return { element, field, value: () => field.input.value.trim() };
}
