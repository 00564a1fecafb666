// Types that the forms of the editor share.

import type { Schema } from "../../api/client";
import type { Draft, Field } from "./formFields";

/** Effects that the server offers. */
export type Library = readonly Schema<"EffectOut">[];

/** A form with its fields. */
export interface Panel {
  element: HTMLElement;
  fields: Field[];
}

/** The draft with what forms need beyond it: changing the selection, and the available effects. */
export interface FormContext extends Draft {
  select: (place: string) => void;
  library: Library;
}
