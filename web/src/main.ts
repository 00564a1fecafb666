import { start } from "./frame";
import "./style.css";
import { restore } from "./theme";
import { VIEWS } from "./views";

restore();
start(VIEWS);
