// Upload of a trials file with measured results, by drag and drop or file dialog, with error messages.

import { api, ok, type Schema } from "../../api/client";
import { ProblemError, describeError } from "../../api/problem";
import { uniqueId, h, put, set } from "../../dom";
import type { Context } from "../../view";

/** The upload area; `onSubmitted` gets the status of the round. */
export function trialsUpload(id: string, now: () => Schema<"Proposals"> | null, onSubmitted: (status: Schema<"SubmissionStatus">) => void, context: Context): { element: HTMLElement } {
  const [input, hint, errorId] = [uniqueId("csv"), uniqueId("hint"), uniqueId("wrong")];
  const file = h("input", { id: input, type: "file", accept: ".csv,text/csv", class: "unseen", "aria-describedby": `${hint} ${errorId}` });
  const errorText = h("p", { id: errorId, class: "why", role: "alert", hidden: true });
  const replaceId = uniqueId("replace");
  const replace = h("input", { id: replaceId, type: "checkbox" });
  const about = h("p", { id: hint, class: "soft" }, "Drop it here. One row for each observation: ", h("code", {}, "trial,t,body,x,y"), "; ", h("code", {}, "trial"), " is the number of the proposal, ", h("code", {}, "t"), " in s from the release, ", h("code", {}, "x"), " and ", h("code", {}, "y"), " in m.");
  const element = h(
    "div",
    { class: "drop stack" },
    h("span", { class: "file row" }, file, h("label", { for: input, class: "button" }, "Submit measured trials (CSV)"), h("span", { class: "row" }, replace, h("label", { for: replaceId }, "replace earlier results"))),
    about,
    errorText,
  );
  const showError = (text: string | null): void => {
    errorText.hidden = text === null;
    put(errorText, text);
    set(file, { "aria-invalid": text === null ? null : "true" });
    element.classList.toggle("wrong", text !== null);
  };
  const submit = async (one: File): Promise<void> => {
    showError(null);
    context.fail(null);
    const round = now()?.round;
    const query = { ...(round === undefined ? {} : { round }), ...(replace.checked ? { replace: true } : {}) };
    try {
      const request = api.POST("/v1/iplw/{id}/trials", {
        params: { path: { id }, query },
        body: (await one.text()) as never,
        bodySerializer: (text: unknown) => text as string,
        headers: { "Content-Type": "text/csv" },
        signal: context.signal,
      });
      onSubmitted(await ok(request));
    } catch (e) {
      const isInputError = e instanceof ProblemError && [400, 409, 413, 422].includes(e.problem.status);
      if (!isInputError) return context.fail(e);
      const { title, detail, field } = describeError(e);
      showError(`${one.name}: ${title}. ${detail}${field ? ` (${field})` : ""}`);
    }
  };
  file.addEventListener("change", () => {
    const one = file.files?.[0];
    if (one) void submit(one);
    file.value = "";
  });
  element.addEventListener("dragover", (event) => (event.preventDefault(), element.classList.add("over")));
  element.addEventListener("dragleave", () => element.classList.remove("over"));
  element.addEventListener("drop", (event) => {
    event.preventDefault();
    element.classList.remove("over");
    const one = event.dataTransfer?.files[0];
    if (one) void submit(one);
  });
  return { element };
}
