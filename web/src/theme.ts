// Light or dark theme: the system's, unless the user chose one.

type Theme = "light" | "dark";
const KEY = "iplw-theme";

/** Applies the stored choice. */
export function restoreTheme(): void {
  const stored = localStorage.getItem(KEY);
  if (stored === "light" || stored === "dark") document.documentElement.dataset.theme = stored;
}

/** The theme in use. */
export function currentTheme(): Theme {
  const stored = document.documentElement.dataset.theme;
  if (stored === "light" || stored === "dark") return stored;
  return matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
}

/** Switches to the other theme and stores the choice. */
export function toggleTheme(): Theme {
  const other = currentTheme() === "dark" ? "light" : "dark";
  document.documentElement.dataset.theme = other;
  localStorage.setItem(KEY, other);
  return other;
}
