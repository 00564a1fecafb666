import { start } from "./frame";
import "./style.css";
import { restoreTheme } from "./theme";
import { VIEW_GROUPS } from "./views";

restoreTheme();
start(VIEW_GROUPS);
