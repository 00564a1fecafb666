// Sign-in for servers with tokens, on a response with status 401.

import { api, ok } from "./api/client";
import { describeError } from "./api/problem";
import { storeToken, token } from "./api/token";
import { uniqueId, h, put } from "./dom";

type Listener = (signedIn: boolean) => void;
let listener: Listener = () => undefined;

/** Calls `now` with whether there is a token, immediately and on changes. */
export function signedIn(now: Listener): void {
  listener = now;
  now(token() !== null);
}

/** Deletes the token. */
export function signOut(): void {
  storeToken("");
  listener(false);
}

/** Asks for a token in a dialogue; then calls `then`. */
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
    h("p", { id: hint }, "This server requires a token. Create one with ", h("code", {}, "iplw token new NAME"), "; it is stored until this tab is closed."),
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
  if (token() !== null) put(message, "The server rejected the token: it is mistyped, revoked or expired.");
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
  // Without a token nothing can be displayed.
  dialog.addEventListener("cancel", (event) => event.preventDefault());
  place.append(dialog);
  dialog.showModal();
}
