// Light or dark: as the system has it, unless somebody chose.

type Theme = "light" | "dark";
const KEY = "iplw-theme";

/** Applies what was chosen before. */
export function restoreTheme(): void {
  const stored = localStorage.getItem(KEY);
  if (stored === "light" || stored === "dark") document.documentElement.dataset.theme = stored;
}

/** What is seen now. */
export function currentTheme(): Theme {
  const stored = document.documentElement.dataset.theme;
  if (stored === "light" || stored === "dark") return stored;
  return matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
}

/** Changes to the other one and keeps it. */
export function toggleTheme(): Theme {
  const other = currentTheme() === "dark" ? "light" : "dark";
  document.documentElement.dataset.theme = other;
  localStorage.setItem(KEY, other);
  return other;
}
