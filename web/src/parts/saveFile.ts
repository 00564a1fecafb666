// Files for the user to save, and texts to copy.

import { h, put } from "../dom";

/** Offers a file for download. */
export function saveFile(name: string, type: string, text: string): void {
  const url = URL.createObjectURL(new Blob([text], { type }));
  h("a", { href: url, download: name }).click();
  URL.revokeObjectURL(url);
}

/** How long a button confirms a copy, ms. */
const CONFIRMATION_MS = 2_000;

/** A button that copies a text, and says so. */
export function copyButton(label: string, text: () => string, say: (text: string) => void, fail: (error: unknown) => void): HTMLButtonElement {
  const button = h("button", { type: "button" }, label);
  button.addEventListener("click", () => {
    copy(text())
      .then(() => {
        say("Copied.");
        put(button, "Copied");
        setTimeout(() => put(button, label), CONFIRMATION_MS);
      })
      .catch(fail);
  });
  return button;
}

async function copy(text: string): Promise<void> {
  // Only secure origins have a clipboard.
  if (!navigator.clipboard) throw new Error(`This browser does not let the page copy. The text is: ${text}`);
  await navigator.clipboard.writeText(text);
}
