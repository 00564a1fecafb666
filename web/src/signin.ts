// Signing in where the server has tokens: asked for when it answers 401.

import { api, ok } from "./api/client";
import { describeError } from "./api/problem";
import { storeToken, token } from "./api/token";
import { uniqueId, h, put } from "./dom";

type Listener = (signedIn: boolean) => void;
let listener: Listener = () => undefined;

/** Calls `now` with whether there is a token, now and when it changes. */
export function signedIn(now: Listener): void {
  listener = now;
  now(token() !== null);
}

/** Forgets the token. */
export function signOut(): void {
  storeToken("");
  listener(false);
}

/** Asks for a token in a dialogue, once; `then` goes on with it. */
export function signIn(place: HTMLElement, then: () => void): void {
  if (place.querySelector("dialog.signin")) return;
  const [id, hint] = [uniqueId("token"), uniqueId("hint")];
  const input = h("input", {
    id,
    type: "password",
    autocomplete: "off",
    spellcheck: "false",
    required: true,
    "aria-describedby": hint,
  });
  const message = h("p", { class: "error", role: "alert", hidden: true });
  const form = h(
    "form",
    {},
    h("h2", {}, "Sign in"),
    h("p", { id: hint }, "This server asks for a token. It is made by ", h("code", {}, "iplw token new NAME"), " and kept here until this tab is closed."),
    message,
    h("label", { for: id }, "Token"),
    input,
    h("button", { type: "submit", class: "main" }, "Sign in"),
  );
  const dialog = h("dialog", { class: "signin", "aria-label": "Sign in" }, form);
  const reject = (error: unknown): void => {
    const { detail } = describeError(error);
    message.hidden = false;
    put(message, detail);
    input.focus();
  };
  if (token() !== null) message.hidden = false;
  if (token() !== null) put(message, "The server does not know the token that was used: it is mistyped, revoked or has run out.");
  form.addEventListener("submit", (event) => {
    event.preventDefault();
    storeToken(input.value.trim());
    ok(api.GET("/v1/tasks"))
      .then(() => {
        listener(true);
        dialog.close();
        dialog.remove();
        then();
      })
      .catch((error: unknown) => {
        storeToken("");
        listener(false);
        reject(error);
      });
  });
  // Without a token there is nothing to see.
  dialog.addEventListener("cancel", (event) => event.preventDefault());
  place.append(dialog);
  dialog.showModal();
}
