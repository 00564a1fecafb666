// A trials file of what was measured, dropped or chosen; what is wrong with it is told at it.

import { api, ok, type Schema } from "../../api/client";
import { ProblemError, describeError } from "../../api/problem";
import { uniqueId, h, put, set } from "../../dom";
import type { Context } from "../../view";

/** A place for files; `came` is told where the round stands then. */
export function dropped(id: string, now: () => Schema<"Proposals"> | null, came: (told: Schema<"Told">) => void, context: Context): { element: HTMLElement } {
  const [input, hint, wrong] = [uniqueId("csv"), uniqueId("hint"), uniqueId("wrong")];
  const file = h("input", { id: input, type: "file", accept: ".csv,text/csv", class: "unseen", "aria-describedby": `${hint} ${wrong}` });
  const why = h("p", { id: wrong, class: "why", role: "alert", hidden: true });
  const replaced = uniqueId("replace");
  const replace = h("input", { id: replaced, type: "checkbox" });
  const about = h("p", { id: hint, class: "soft" }, "Drop it here. A row an observation: ", h("code", {}, "trial,t,body,x,y"), "; ", h("code", {}, "trial"), " is the number of the proposal, ", h("code", {}, "t"), " in s from the moment things were let go, ", h("code", {}, "x"), " and ", h("code", {}, "y"), " in m.");
  const element = h(
    "div",
    { class: "drop stack" },
    h("span", { class: "file row" }, file, h("label", { for: input, class: "button" }, "Send measured trials (CSV)"), h("span", { class: "row" }, replace, h("label", { for: replaced }, "in place of what was sent before"))),
    about,
    why,
  );
  const refuse = (text: string | null): void => {
    why.hidden = text === null;
    put(why, text);
    set(file, { "aria-invalid": text === null ? null : "true" });
    element.classList.toggle("wrong", text !== null);
  };
  const take = async (one: File): Promise<void> => {
    refuse(null);
    context.fail(null);
    const round = now()?.round;
    const query = { ...(round === undefined ? {} : { round }), ...(replace.checked ? { replace: true } : {}) };
    try {
      const asked = api.POST("/v1/iplw/{id}/trials", {
        params: { path: { id }, query },
        body: (await one.text()) as never,
        bodySerializer: (text: unknown) => text as string,
        headers: { "Content-Type": "text/csv" },
        signal: context.signal,
      });
      came(await ok(asked));
    } catch (e) {
      const refused = e instanceof ProblemError && [400, 409, 413, 422].includes(e.problem.status);
      if (!refused) return context.fail(e);
      const { title, detail, field } = describeError(e);
      refuse(`${one.name}: ${title}. ${detail}${field ? ` (${field})` : ""}`);
    }
  };
  file.addEventListener("change", () => {
    const one = file.files?.[0];
    if (one) void take(one);
    file.value = "";
  });
  element.addEventListener("dragover", (event) => (event.preventDefault(), element.classList.add("over")));
  element.addEventListener("dragleave", () => element.classList.remove("over"));
  element.addEventListener("drop", (event) => {
    event.preventDefault();
    element.classList.remove("over");
    const one = event.dataTransfer?.files[0];
    if (one) void take(one);
  });
  return { element };
}
