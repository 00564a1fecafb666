// Light or dark: as the system has it, unless somebody chose.

type Theme = "light" | "dark";
const KEY = "iplw-theme";

/** Applies what was chosen before. */
export function restore(): void {
  const chosen = localStorage.getItem(KEY);
  if (chosen === "light" || chosen === "dark") document.documentElement.dataset.theme = chosen;
}

/** What is seen now. */
export function seen(): Theme {
  const chosen = document.documentElement.dataset.theme;
  if (chosen === "light" || chosen === "dark") return chosen;
  return matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
}

/** Changes to the other one and keeps it. */
export function toggle(): Theme {
  const other = seen() === "dark" ? "light" : "dark";
  document.documentElement.dataset.theme = other;
  localStorage.setItem(KEY, other);
  return other;
}
