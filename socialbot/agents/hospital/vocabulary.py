"""Sentences and words for the deeds of robots and nurses, the words in English, German, French and Spanish."""

from socialbot.core.vocabulary import Deed, Vocabulary

PHRASES = {
    "a_navigate_to": "goes to {1}",
    "a_open_door": "opens the door of {1}",
    "a_approach_nurse": "goes up to {1}",
    "a_authenticate_nurse": "authenticates: {0} with {1}",
    "end": "finishes its part",
    "a_authorize_patrol": "agrees on the patrol: {0} with {1}",
    "a_patrol_room": "patrols {1}",
    "a_adapt_room": "tidies {1}",
    "a_authorize_disinfect": "agrees on the light: {0} with {1}",
    "a_disinfect_room": "disinfects {1}",
    "a_charge": "charges",
    "a_infected_room": "says that {1} is to be disinfected",
}
"""Sentences for actions, by name."""

VOCABULARY = Vocabulary(
    deeds=(
        Deed(
            calls=("a_navigate_to",),
            words={
                "en": ("navigate", "go", "drive", "move", "travel", "enter", "come"),
                "de": ("fahren", "gefahren", "fuhr", "gehen", "gegangen", "ging"),
                "fr": ("aller", "allé", "rouler", "entrer", "entré"),
                "es": ("ir", "fue", "fuiste", "entrar", "entró"),
            },
        ),
        Deed(
            calls=("a_open_door",),
            words={
                "en": ("open door", "open"),
                "de": ("tür öffnen", "tür geöffnet", "öffnen", "geöffnet", "aufmachen", "aufgemacht"),
                "fr": ("ouvrir porte", "ouvrir", "ouvert"),
                "es": ("abrir puerta", "abrir", "abrió", "abriste"),
            },
        ),
        Deed(
            calls=("a_approach_nurse",),
            words={
                "en": ("approach", "go up", "walk up", "come up"),
                "de": ("nähern", "genähert", "ansprechen"),
                "fr": ("approcher", "approché"),
                "es": ("acercar", "acercó", "acercaste"),
            },
        ),
        Deed(
            calls=("a_patrol_room",),
            words={
                "en": ("patrol", "inspect", "check", "survey"),
                "de": ("patrouillieren", "patrouilliert", "kontrollieren", "kontrolliert"),
                "fr": ("patrouiller", "patrouillé", "inspecter", "inspecté"),
                "es": ("patrullar", "patrulló", "inspeccionar", "inspeccionó"),
            },
        ),
        Deed(
            calls=("a_adapt_room",),
            words={
                "en": ("tidy", "clean", "prepare"),
                "de": ("aufräumen", "aufgeräumt", "säubern", "gesäubert"),
                "fr": ("ranger", "rangé", "nettoyer", "nettoyé"),
                "es": ("ordenar", "ordenó", "limpiar", "limpió"),
            },
        ),
        Deed(
            calls=("a_disinfect_room",),
            words={
                "en": ("disinfect", "sterilize", "sanitize", "irradiate"),
                "de": ("desinfizieren", "desinfiziert"),
                "fr": ("désinfecter", "désinfecté"),
                "es": ("desinfectar", "desinfectó"),
            },
        ),
        Deed(
            calls=("a_charge",),
            words={
                "en": ("charge", "recharge"),
                "de": ("laden", "geladen", "aufladen"),
                "fr": ("charger", "chargé", "recharger"),
                "es": ("cargar", "cargó", "recargar"),
            },
        ),
    ),
    names={
        "room": {"de": ("Zimmer", "Raum"), "fr": ("chambre", "salle"), "es": ("habitación", "sala", "cuarto")},
        "nurse": {
            "de": ("Krankenschwester", "Pflegerin", "Pfleger", "Schwester"),
            "fr": ("infirmière", "infirmier"),
            "es": ("enfermera", "enfermero"),
        },
    },
)
