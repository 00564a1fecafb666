// Signing in where the server has tokens: asked for when it answers 401.

import { api, ok } from "./api/client";
import { told } from "./api/problem";
import { keep, token } from "./api/token";
import { fresh, h, put } from "./dom";

type Listener = (signedIn: boolean) => void;
let listener: Listener = () => undefined;

/** Calls `now` with whether there is a token, now and when it changes. */
export function signedIn(now: Listener): void {
  listener = now;
  now(token() !== null);
}

/** Forgets the token. */
export function signOut(): void {
  keep("");
  listener(false);
}

/** Asks for a token in a dialogue, once; `then` goes on with it. */
export function signIn(place: HTMLElement, then: () => void): void {
  if (place.querySelector("dialog.signin")) return;
  const [id, hint] = [fresh("token"), fresh("hint")];
  const input = h("input", {
    id,
    type: "password",
    autocomplete: "off",
    spellcheck: "false",
    required: true,
    "aria-describedby": hint,
  });
  const said = h("p", { class: "error", role: "alert", hidden: true });
  const form = h(
    "form",
    {},
    h("h2", {}, "Sign in"),
    h("p", { id: hint }, "This server asks for a token. It is made by ", h("code", {}, "iplw token new NAME"), " and kept here until this tab is closed."),
    said,
    h("label", { for: id }, "Token"),
    input,
    h("button", { type: "submit", class: "main" }, "Sign in"),
  );
  const dialog = h("dialog", { class: "signin", "aria-label": "Sign in" }, form);
  const refuse = (error: unknown): void => {
    const { detail } = told(error);
    said.hidden = false;
    put(said, detail);
    input.focus();
  };
  if (token() !== null) said.hidden = false;
  if (token() !== null) put(said, "The server does not know the token that was used: it is mistyped, revoked or has run out.");
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    keep(input.value.trim());
    ok(api.GET("/v1/tasks"))
      .then(() => {
        listener(true);
        dialog.close();
        dialog.remove();
        then();
      })
      .catch((error: unknown) => {
        keep("");
        listener(false);
        refuse(error);
      });
  });
  // Without a token there is nothing to see.
  dialog.addEventListener("cancel", (event) => event.preventDefault());
  place.append(dialog);
  dialog.showModal();
}
